"""Contact beside books: friction, limit loads, Hertz, Cattaneo and Mindlin, NAFEMS, each with its reference, what is found, and a picture.

The page ``docs/contact_benchmarks.md`` has what this study leaves in page.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.side_view import side_view
from benchmarks.kit.study import Study
from benchmarks.monolithic import Monolithic
from benchmarks.problems import contact_cases as cases, tools
from benchmarks.problems.cantilevers import beams, tip
from benchmarks.problems.limits import arch, belt, belt_limit, incline, shaft, stack, stack_limit, wedge
from benchmarks.studies.limits import holds, jams, thinnest
from orchestrator import Solution, config_from, solve

TOLERANCE, MOST = 1e-4, 2000  # law residual, iterations
XZ, XY = (0, 2), (0, 1)
Name = Literal["belt", "wedge", "arch", "incline", "boxes_slide", "boxes_tip", "pull_out", "cantilevers", "mindlin", "nafems", "ironing",
               "ball", "roller", "stiff_cap"]


@dataclass
class Found:
    """What a case leaves: lines of what was compared (quantity, reference, found, deviation), the figure, iterations, seconds."""

    lines: list[tuple[str, str, str, float]] = field(default_factory=list)
    figure: Any = None
    iterations: list[int] = field(default_factory=list)
    seconds: float = 0.0
    between: bool = False  # whether what is found lies between two runs

    def solve(self, problem: Mapping[str, Any], **method: Any) -> Solution:
        """One run."""
        solved = solve(config_from({**problem, "method": {"tolerance": {"law": TOLERANCE}, "max_iterations": MOST, **method}}))
        self.iterations.append(solved.iterations)
        self.seconds += solved.summary["timing"]["total"]
        return solved

    def add(self, quantity: str, reference: float, found: float) -> None:
        """A number beside its reference."""
        self.lines.append((quantity, f"{reference:.4g}", f"{found:.4g}", abs(found / reference - 1)))


class Settings(Keys):
    """What may be set."""

    only: list[Name] = Field([], description="the cases to run; none: all")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All cases, or those chosen, each on disk before the next begins."""
    study.columns = ("case", "quantity", "reference", "found", "deviation", "iterations", "seconds")
    pages = []
    for name, (title, most, measure) in CASES.items():
        if settings.only and name not in settings.only:
            continue
        found = measure(study.folder)
        for quantity, reference, value, off in found.lines:
            row = {"quantity": quantity, "reference": reference, "found": value, "deviation": round(off, 5),
                   "iterations": ", ".join(map(str, found.iterations)), "seconds": round(found.seconds, 1), "stop_reason": "-"}
            study.note({"case": name, **row}, f"{name}: {quantity}: {value}, reference {reference}, off by {off:.2%}")
            study.target(f"{name}: {quantity}", f"within {most:.0%} of {reference}", value, off <= most)
        if found.figure is not None:
            study.figure(found.figure, f"contact_{name}.png")
        pages.append(_page(name, title, found))
    (study.folder / "page.md").write_text("\n".join(pages), encoding="utf-8")


def _page(name: str, title: str, found: Found) -> str:
    """What the documentation shows of a case."""
    rows = [f"| {quantity} | {reference} | {value} | {f'at most {off:.0%}' if found.between else f'{off:.2%}'} |"
            for quantity, reference, value, off in found.lines]
    return "\n".join([f"## {title}", "", "| | reference | found | off by |", "|---|---|---|---|", *rows, "",
                      f"Iterations: {', '.join(map(str, found.iterations))}.", "", f"![{title}](images/contact_{name}.png)", ""])


def _limit(make: Callable[..., dict[str, Any]], plane: tuple[int, int], near: float, folder: Path) -> Found:
    """A load below a limit, and one above it: the first is carried, the second told as a limit load; else it is off by all of it."""
    found, shares = Found(between=True), (1 - near, 1 + near)
    ended = [found.solve(make(folder, share)) for share in shares]
    right = [s.stop_reason == wanted for s, wanted in zip(ended, ("converged", "limit load"))]
    text = "; ".join(f"at {share:g}: {'carried' if s.stop_reason == 'converged' else s.stop_reason}" for s, share in zip(ended, shares))
    found.lines.append(("load over the limit of theory", "1", text, near if all(right) else 1.0))
    found.figure, ((axes,),) = panels(size=(5.0, 3.2))
    side_view(axes, ended[0], plane)
    return found


def _arch(folder: Path, share: float) -> dict[str, Any]:
    return arch(folder, thickness=thinnest(15) / share, voussoirs=15)


def _wedge(folder: Path, share: float) -> dict[str, Any]:
    return wedge(folder, pull=share * jams(folder))


def _shaft(folder: Path, share: float) -> dict[str, Any]:
    return shaft(folder, pull=share * holds(folder))


def _cantilevers(folder: Path) -> Found:
    found = Found()
    solved = found.solve(beams(10, 0.5))
    whole = Monolithic(solved.scene).solve()[-1].parts
    found.add("deflection of the tip, L/h = 10, μ = 0.5, beside a solution in one piece", tip(whole, solved.scene),
              tip([u[-1] for u in solved.parts], solved.scene))
    found.figure, ((axes,),) = panels(size=(5.0, 2.4))
    side_view(axes, solved, XZ)
    return found


def _of_lines(solved: Solution, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x of the lines of nodes across a slice that have an area, and the mean (steps, lines) of values (steps, N) on them, by area."""
    fields = solved.interfaces
    x, line = np.unique(np.round(solved.scene.mesh.nodes[fields.nodes, 0], 9), return_inverse=True)
    width = np.bincount(line, fields.area)
    there = width > 0  # not where a symmetry holds nodes
    return x[there], np.stack([np.bincount(line, row * fields.area) for row in values])[:, there] / width[there]


def _mindlin(folder: Path) -> Found:
    """Loading, unloading, reversed: tractions beside the closed form, forces beside Masing's branches."""
    found = Found()
    solved = found.solve(cases.cylinder_pushed(folder))
    fields, n = solved.interfaces, cases.LOADS
    force = np.array(solved.summary["reactions"])[-1] / (2 * cases.FINE)
    share = force[:, 0] / (cases.FRICTION * -force[:, 2])
    x, pressure = _of_lines(solved, fields.pressure)
    _, friction = _of_lines(solved, np.abs(fields.friction_traction).max(axis=2) * np.sign(fields.friction_traction[:, :, 0]))
    found.figure, (axes,) = panels(1, 2, size=(8.6, 3.4))
    way = np.sign(friction[n] @ np.ones(len(x)))
    for t, before, label, colour in ((n, None, "pushed", BLUE), (n + 2, share[n], "let go", ORANGE), (2 * n, share[n], "reversed", GREEN)):
        a, p0 = cases.hertz_line(-force[t, 2], cases.RADIUS, cases.YOUNG, cases.YOUNG)
        exact = cases.pushed(x, a, share[t], before)
        got = way * friction[t] / (cases.FRICTION * p0)
        inside = np.abs(x) < 0.95 * a
        off = float(np.abs(got - exact)[inside].mean())
        found.lines.append((f"friction {label}: largest; off by on the mean, over μp₀", f"{np.abs(exact).max():.3f}",
                            f"{np.abs(got).max():.3f}", off))
        fine = np.linspace(-1.2 * a, 1.2 * a, 400)
        axes[1].plot(fine / a, cases.pushed(fine, a, share[t], before), color=colour, linewidth=1, label=label)
        axes[1].plot(x / a, got, "o", color=colour, markersize=2.5)
    first = share[1:n + 1]
    for k, (back, forth) in enumerate(zip(range(n + 1, 2 * n + 1), range(2 * n + 1, 3 * n + 1))):
        if k == n // 2 - 1:  # half-way
            found.add("force when it is let go by half, by Masing's rule, over μP", share[n] - 2 * first[k], share[back])
        if k == n - 1:
            found.add("force reversed altogether, over μP", -share[n], share[back])
            found.add("force pushed again, the loop closed, over μP", share[n], share[forth])
    move = np.array([0.0, *(k / n for k in range(1, n + 1)), *(1 - 2 * k / n for k in range(1, n + 1)),
                     *(2 * k / n - 1 for k in range(1, n + 1))])
    masing = np.r_[0.0, first, share[n] - 2 * first, -share[n] + 2 * first]
    axes[0].plot(move, masing, color=GREY, linewidth=1, label="Masing's branches")
    axes[0].plot(move, share, "o", color=BLUE, markersize=4, label="found")
    axes[0].set(xlabel="push, over the largest", ylabel="Q / μP")
    axes[1].set(xlim=(-1.2, 1.2), xlabel="x / a", ylabel="friction / μp₀")
    return found


def _nafems(folder: Path) -> Found:
    """Largest pressure and half-width."""
    found = Found()
    solved = found.solve(cases.nafems_cylinder(folder))
    fields = solved.interfaces
    x, (pressure,) = _of_lines(solved, fields.pressure)
    a, peak = cases.hertz_line(cases.FORCE, cases.LARGE, cases.STEEL, cases.ALUMINIUM)
    loaded = pressure > 0.2 * pressure.max()
    slope, top = np.polyfit(x[loaded] ** 2, pressure[loaded] ** 2, 1)  # p² is linear in x²
    found.add("largest pressure, N/mm²", peak, float(np.sqrt(top)))
    found.add("half-width of the contact, mm", a, float(np.sqrt(-top / slope)))
    found.figure, ((one, two),) = panels(1, 2, size=(8.6, 3.4))
    side_view(one, solved, XY)
    fine = np.linspace(0, 1, 200)
    two.plot(a * fine, peak * np.sqrt(1 - fine**2), color=GREY, label="Hertz")
    two.plot(x, pressure, "o", color=BLUE, markersize=3, label="found")
    two.set(xlim=(0, 1.5 * a), xlabel="x (mm)", ylabel="pressure (N/mm²)")
    return found


def _ironing(folder: Path) -> Found:
    """Friction over pressure, and how much the pressing force changes on the way."""
    found = Found()
    solved = found.solve(cases.ironing())
    found.solve(cases.ironing(pairing="fixed"))  # for its iterations alone
    force = np.array(solved.summary["reactions"])[-1]
    drag, push = cases.middle(np.abs(force[:, 0])), cases.middle(-force[:, 2])
    share = drag / push
    found.add("drag over the pressing force, the step farthest off", cases.IRON, float(share[np.abs(share - cases.IRON).argmax()]))
    found.add("pressing force along the way, largest over smallest", 1.0, float(push.max() / push.min()))
    found.figure, ((one, two),) = panels(1, 2, size=(8.6, 3.0))
    side_view(one, solved, XZ, most=0.0)
    two.plot(cases.WAY[1:], -force[1:, 2], "o-", color=BLUE, label="pressing")
    two.plot(cases.WAY[1:], np.abs(force[1:, 0]), "o-", color=ORANGE, label="drag")
    two.set(xlabel="way of the die", ylabel="force", ylim=(0, None))
    return found


def _under(solved: Solution, found: Found, peak: float, half: float) -> None:
    """Largest pressure and size of a contact beside Hertz's for the force that is found, with the picture."""
    fields = solved.interfaces
    r = np.linalg.norm(solved.scene.mesh.nodes[fields.nodes][:, :2 if "ball" in solved.scene.name else 1], axis=1)
    chosen = fields.area > 0
    r, pressure = r[chosen], fields.pressure[0, chosen]
    loaded = pressure > 0.2 * pressure.max()
    slope, top = np.polyfit(r[loaded] ** 2, pressure[loaded] ** 2, 1)  # p² is linear in r²
    found.add("largest pressure for the force that is found", peak, float(np.sqrt(top)))
    found.add("size of the contact for this force", half, float(np.sqrt(-top / slope)))
    exact = peak * np.sqrt(np.maximum(1 - (r / half) ** 2, 0))
    found.add("pressure at the point that is farthest off it, below 0.9 of the contact's size, over the largest", 1.0,
              1 + float(np.abs(pressure - exact)[r < 0.9 * half].max()) / peak)
    found.figure, ((one, two),) = panels(1, 2, size=(8.6, 3.4))
    side_view(one, solved, XZ)
    fine = np.linspace(0, 1, 200)
    two.plot(fine, np.sqrt(1 - fine**2), color=GREY, label="Hertz")
    two.plot(r / half, pressure / peak, "o", color=BLUE, markersize=3, label="found")
    two.set(xlim=(0, 1.5), xlabel="r / a", ylabel="p / p₀")


def _ball(folder: Path) -> Found:
    """A rigid ball that is moved; of its force, a quarter presses on a quarter of the block."""
    found = Found()
    solved = found.solve(tools.ball(folder))
    force = -4 * solved.reactions[-1, 0, 2]
    half = (0.75 * force * tools.RADIUS / tools.MODULUS) ** (1 / 3)
    _under(solved, found, 1.5 * force / (np.pi * half**2), half)
    return found


def _roller(folder: Path) -> Found:
    """A rigid roller that is moved, on half a slice."""
    found = Found()
    solved = found.solve(tools.roller(folder))
    force = -2 * solved.reactions[-1, 0, 2] / np.ptp(solved.scene.mesh.nodes[:, 1])
    half = np.sqrt(4 * force * tools.RADIUS / (np.pi * tools.MODULUS))
    _under(solved, found, 2 * force / (np.pi * half), half)
    return found


def _stiff_cap(folder: Path) -> Found:
    """The force on a rigid ball beside that on a meshed body of its shape."""
    found = Found()
    meshed, rigid = (found.solve(tools.cap(folder, meshed)) for meshed in (True, False))
    found.add("force at the same depth", float(meshed.reactions[-1, 0, 2]), float(rigid.reactions[-1, 0, 2]))
    found.figure, ((axes,),) = panels(size=(5.0, 3.2))
    side_view(axes, rigid, XZ)
    return found


CASES: dict[str, tuple[str, float, Callable[[Path], Found]]] = {
    "belt": ("Belt on a drum, 160°, μ = 0.2 (Euler and Eytelwein)", 0.01,
             partial(_limit, lambda folder, share: belt(folder, ratio=share * belt_limit(0.2)), XY, 0.01)),
    "wedge": ("Wedge of 10°, μ = 0.3, pressed, let go, pulled", 0.01, partial(_limit, _wedge, XY, 0.01)),
    "arch": ("Semicircular arch of 15 voussoirs under its weight (line of thrust)", 0.01, partial(_limit, _arch, XY, 0.01)),
    "incline": ("Box on an incline beside a press fit", 0.01, partial(
        _limit, lambda folder, share: incline(folder, share=share), XZ, 0.01)),
    "boxes_slide": ("Five loose boxes pushed, μ = 0.3: they slide", 0.01, partial(
        _limit, lambda folder, share: stack(folder, push=share * stack_limit(0.3), friction=0.3), XZ, 0.01)),
    "boxes_tip": ("Five loose boxes pushed, μ = 0.6: they tip over", 0.01, partial(
        _limit, lambda folder, share: stack(folder, push=share * stack_limit(0.6), friction=0.6), XZ, 0.01)),
    "pull_out": ("Shaft pulled out of a shrunk ring", 0.01, partial(_limit, _shaft, XY, 0.01)),
    "cantilevers": ("Two cantilevers, one on the other", 0.01, _cantilevers),
    "mindlin": ("Cylinder pressed, pushed, let go and reversed (Cattaneo, Mindlin and Deresiewicz)", 0.05, _mindlin),
    "nafems": ("NAFEMS' cylinder of steel on a block of aluminium (Konter 2006, benchmark 1; Hertz)", 0.02, _nafems),
    "ironing": ("A die that irons a slab, pairing: follow, then fixed", 0.02, _ironing),
    "ball": ("A rigid ball without a mesh on a block (Hertz)", 0.02, _ball),
    "roller": ("A rigid roller without a mesh on a slab in plane strain (Hertz)", 0.02, _roller),
    "stiff_cap": ("A rigid ball beside a meshed body of its shape, a thousand times as stiff as the block", 0.02, _stiff_cap),
}
