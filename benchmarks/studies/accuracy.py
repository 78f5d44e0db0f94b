"""``method: {accuracy: …}`` beside true errors and uniform meshes: an L, a hole, a slit; a punch, a ball and ten grains in contact; STEP
assemblies, a bolted lap joint meshed apart and ``as1-tu-203``.

True errors are of the energy norm, beside a graded mesh of ten-node tets:

- of what is bonded or in contact without friction, of planes, by energies, which displacements minimise: 2(Π_h − Π). What Π is short of
  that of the finest mesh is its own error, estimated, times what the last two meshes measure of such estimates.
- of the others as the distance from that mesh, and its own error, estimated, is added as the other leg of a right-angled triangle. Where
  it is a third of the sum, a tenth more or less of it changes the sum by a hundredth. Where faces are curved all is rough: every mesh has
  other bodies.

Seconds are of the processor, all processes together: what a busy machine does not change.

Along an edge where displacements are of r^λ, r the distance from it, tets that are about as long as thick leave N^−min(p/3, λ) at best,
p = 1 or 2 their order (docs/accuracy.md). So rates are held against that beside p/3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gmsh
import numpy as np

from benchmarks.kit.apart import apart
from benchmarks.kit.commands import cpu_seconds
from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels, plain_ticks
from benchmarks.kit.meshes import session
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.kit.true_errors import left
from benchmarks.problems.lap_joint import joint_scene
from orchestrator import Solution, config_from
from orchestrator.accuracy.loop import run as refined
from orchestrator.accuracy.measured import Energies, energies
from orchestrator.config.load import Loaded
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.run import Means

LEAST = 1 / 3  # of what is asked: a smaller true error is more than was asked for
COARSEST, FINER = 0.25, 2**0.5  # sizes of the first mesh, and of a uniform mesh over the next one's
PLANE = ("l_shape", "hole", "slit", "punch")  # whose energies tell true errors
FEWER, HARDLY_MORE = 5.0, 1.2  # times the seconds that uniform meshes take: where stresses are singular, and where they are not
SINGULAR, REGULAR = ("l_shape", "slit", "punch"), ("hole", "hertz")
ENDLESS = {"l_shape": 0.46, "slit": 0.5, "hole": 0.2, "punch": 0.29, "hertz": 0.0}  # 1 − λ of all edges at most; of 202.5° at the hole
EXPONENT = {"l_shape": 0.5445, "slit": 0.5}  # λ < 2/3: sin 3πλ/2 = λ; a crack's tip, until elements are smaller than the slit is wide


class Settings(Keys):
    """What to solve."""

    cases: list[str] = ["l_shape", "hole", "slit", "punch", "hertz", "grains", "lap_joint", "as1"]
    elements: list[str] = ["P1", "P2"]
    asked: dict[str, list[float]] = {"P1": [0.2, 0.1], "P2": [0.1, 0.05, 0.02, 0.01]}
    of_assemblies: dict[str, list[float]] = {"P1": [0.6], "P2": [0.4]}  # in place of these
    most: dict[str, int] = {"P1": 60_000, "P2": 60_000}  # elements for one accuracy
    reference: dict[str, int] = {"l_shape": 40_000, "hole": 12_000, "slit": 35_000, "punch": 14_000,
                                 "hertz": 24_000, "grains": 15_000, "lap_joint": 12_000, "as1": 25_000}  # ten-node tets, about
    split_above: int = 0  # unknowns from which bodies of ``PLANE`` are cut, but for uniform meshes; 0: none is
    limit: float = 20.0  # seconds: a uniform mesh is solved on where it is foreseen to take less


def run(study: Study, settings: Settings = Settings()) -> None:
    """All accuracies of a case beside one reference, and uniform meshes of either element."""
    study.columns = ("case", "element", "asked", "mesh", "elements", "estimated", "true_error", "effectivity", "seconds", "cpu_seconds")
    for name in settings.cases:
        truth = _reference(study, name, settings)
        study.console.print(f"{name}: reference of {len(truth.solution.scene.mesh.cells):,} elements, its error about {truth.error:.2%}")
        for element in settings.elements:
            accuracies = (settings.of_assemblies if name in ASSEMBLIES else settings.asked)[element]
            uniform = _uniform(study, name, element, min(accuracies), truth, settings.limit) if name not in ALONE else []
            for asked in sorted(accuracies, reverse=True):
                if not _asked(study, name, element, asked, truth, uniform, settings):
                    break  # a smaller one would not be reached either
            _rate(study, name, element)
        study.target(f"{name}: reference", "told", f"{truth.error:.2%}", True)
    study.figure(_picture(study, settings))


@dataclass(frozen=True)
class Truth:
    """What stands for the exact solution: the one on the finest mesh.

    error : its own, relative; energies : its own, None where true errors are distances from it
    """

    solution: Solution
    error: float
    energies: Energies | None

    def __call__(self, solution: Solution) -> float:
        """True relative error of another solution."""
        if self.energies is None:
            return math.hypot(apart(solution, self.solution), self.error)
        return math.sqrt(max(_energies(solution).potential - self.energies.potential, 0.0) / self.energies.energy + self.error**2)


def _energies(solution: Solution) -> Energies:
    estimator = estimator_of(solution.scene)
    return energies(solution, estimator, estimator(solution.sides))


def problem(folder: Path, name: str, element: str, h: float = COARSEST, split_above: int = 0) -> dict[str, Any]:
    """One of ``MADE`` or ``ASSEMBLIES``, its model written to the folder; elements of size h where the first mesh has ``COARSEST``; those of
    ``PLANE`` are cut into subdomains of no more unknowns than ``split_above``."""
    code = {"name": f"{name}-{element}", "blackbox": {"code": "freefem", "element": element, "workers": 2}, "output": {"figures": False}}
    if name in ASSEMBLIES:
        made = ASSEMBLIES[name](folder, h / COARSEST)
        made.pop("method", None)
        return {**made, **code}
    draw, boundary, law = MADE[name]
    path = folder / f"{name}.brep"
    if draw and not path.is_file():
        with session():
            draw(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(path))
    grains = {"polycrystal": {"grains": 10, "size": 1, "h": h, "seed": 7}}
    mesh = {"step": str(path), "h": h, "conforming": draw != _ball} if draw else grains
    cut = {"groups": True, "split_above": split_above} if split_above and name in PLANE else "groups"
    return {**code, "mesh": mesh, "subdomains": cut, "materials": [{"young": 1000.0, "poisson": 0.3}], "interfaces": [law],
            "boundary": boundary}


def _lap_joint(folder: Path, coarser: float) -> dict[str, Any]:
    """Bolts tightened, then pulled: friction .2."""
    return joint_scene(folder, [1.0], (8, 12.0 * coarser, 6.0 * coarser))


def _as1(_: Path, coarser: float) -> dict[str, Any]:
    """Eighteen solids, bonded."""
    return {"mesh": {"step": "gmsh:as1-tu-203.stp", "h": 20.0 * coarser}, "subdomains": "groups",
            "materials": [{"young": 200e3, "poisson": 0.3}],
            "boundary": [_held("z", 0, [0, 0, 0]), _pulled("x", 190, [10, 0, 0])]}


def _l_shape(occ) -> None:
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 0.25, 1))], [(3, occ.addBox(0.5, -0.1, 0.5, 0.6, 0.5, 0.6))])


def _hole(occ) -> None:
    """A quarter of a square plate with a hole of sixteen sides."""
    angles = np.linspace(0, np.pi / 2, 5)
    corners = [(0, 0), *(0.25 * np.stack([np.cos(angles), np.sin(angles)], 1))]
    points = [occ.addPoint(x, y, 0) for x, y in corners]
    loop = occ.addCurveLoop([occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])])
    away = occ.extrude([(2, occ.addPlaneSurface([loop]))], 0, 0, 0.2)
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 1, 0.2))], [entity for entity in away if entity[0] == 3])


def _slit(occ) -> None:
    """Half through, a hundredth of the plate's height wide."""
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 0.25, 1))], [(3, occ.addBox(-0.1, -0.1, 0.495, 0.6, 0.5, 0.01))])


def _punch(occ) -> None:
    occ.addBox(0, 0, 0, 2, 2, 1)
    occ.addBox(0.5, 0.5, 1, 1, 1, 0.5)


def _ball(occ) -> None:
    """A quarter of a ball of radius one on a block: Hertz."""
    occ.intersect([(3, occ.addSphere(0, 0, 1, 1))], [(3, occ.addBox(0, 0, -0.1, 2, 2, 0.8))])
    occ.addBox(0, 0, -1, 1, 1, 1)


def _held(axis: str, at: float, displacement: list) -> dict[str, Any]:
    return {"on": {"plane": axis, "at": at}, "displacement": displacement}


def _pulled(axis: str, at: float, traction: list) -> dict[str, Any]:
    return {"on": {"plane": axis, "at": at}, "traction": traction}


BONDED, SMOOTH, ROUGH = {"law": "perfect"}, *({"law": "contact", "friction": friction} for friction in (0.0, 0.3))
MADE: dict[str, tuple[Callable | None, list, dict]] = {  # what draws it, boundary, law of what is between bodies
    "l_shape": (_l_shape, [_held("z", 0, [0, 0, 0]), _pulled("x", 1, [0, 0, 1])], BONDED),
    "hole": (_hole, [_held("x", 0, [0, None, None]), _held("y", 0, [None, 0, None]), _held("z", 0, [None, None, 0]),
                     _pulled("x", 1, [1, 0, 0])], BONDED),
    "slit": (_slit, [_held("z", 0, [0, 0, 0]), _pulled("z", 1, [0, 0, 1])], BONDED),
    "punch": (_punch, [_held("z", 0, [0, 0, 0]), _held("z", 1.5, [0, 0, -0.01])], SMOOTH),
    "hertz": (_ball, [_held("x", 0, [0, None, None]), _held("y", 0, [None, 0, None]), _held("z", -1, [None, None, 0]),
                      _held("z", 0.7, [None, None, -0.03])], SMOOTH | {"between": "auto", "within": 0.1}),
    "grains": (None, [_held("z", 0, [0, 0, 0]), _held("z", 1, [0, 0, -0.01])], ROUGH),
}
ASSEMBLIES: dict[str, Callable[[Path, float], dict[str, Any]]] = {"lap_joint": _lap_joint, "as1": _as1}
ALONE = ("grains",)  # no uniform meshes: half the first size gives other grains


def graded(study: Study, made: Mapping[str, Any], method: Mapping[str, Any]) -> tuple[list[Solution], float]:
    """The solutions on all meshes, and seconds of the processor, results written and all."""
    found: list[Solution] = []

    def kept(solution: Solution) -> Solution:
        found.append(solution)
        return solution

    begin = cpu_seconds()
    config = config_from({**made, "method": dict(method)})
    refined(Loaded(config), output=study.folder / made["name"], quiet=True, means=Means(judge=kept))
    return found, cpu_seconds() - begin


def _reference(study: Study, name: str, settings: Settings) -> Truth:
    made, elements = problem(study.folder, name, "P2", split_above=settings.split_above), settings.reference[name]
    found, _ = graded(study, {**made, "name": f"{name}-reference"}, {"accuracy": {"error": 1e-3, "elements": elements}})
    error = found[-1].summary["accuracy"]["meshes"][-1]["mesh_error"]
    if name not in PLANE or len(found) < 2:
        return Truth(found[-1], error, None)
    coarse, fine = map(_energies, found[-2:])
    return Truth(found[-1], left(coarse, fine), fine)


def _uniform(study: Study, name: str, element: str, asked: float, true: Truth, limit: float) -> list[tuple[float, float]]:
    """True errors and seconds of meshes of one size each, as fine as ``limit`` allows."""
    done, h = [], COARSEST / 2
    while len(done) < 2 or done[-1][0] > asked and done[-1][1] ** 2 / done[-2][1] < limit:
        made = problem(study.folder, name, element, h)
        (solution,), seconds = graded(study, {**made, "name": f"{name}-uniform"}, {"tolerance": {"error": asked / 10}})
        error = true(solution)
        told = estimator_of(solution.scene)(solution.sides).relative
        done.append((error, seconds))
        study.note({"case": name, "element": element, "asked": None, "mesh": "uniform", "elements": len(solution.scene.mesh.cells),
                    "estimated": told, "true_error": error, "effectivity": told / error,
                    "cpu_seconds": round(seconds, 2)}, f"{name}, {element}, uniform: true {error:.2%}, {seconds:.1f} s")
        h /= FINER
    return done


def _asked(study: Study, name: str, element: str, asked: float, true: Truth, uniform: list[tuple[float, float]],
           settings: Settings) -> bool:
    """One accuracy with at most so many elements, a row a mesh. Whether it was reached, by its own estimate."""
    made, most = problem(study.folder, name, element, split_above=settings.split_above), settings.most[element]
    found, seconds = graded(study, made, {"accuracy": {"error": asked, "elements": most}})
    meshes = found[-1].summary["accuracy"]["meshes"]
    for number, (solution, done) in enumerate(zip(found, meshes), 1):
        error = true(solution)
        study.note({"case": name, "element": element, "asked": asked, "mesh": number, "elements": done["elements"],
                    "estimated": done["error"], "true_error": error, "effectivity": done["error"] / error,
                    "seconds": round(done["seconds"], 2), "cpu_seconds": round(seconds, 2) if number == len(meshes) else None},
                   f"{name}, {element}, {asked:.0%}, mesh {number}: estimated {done['error']:.2%}, true {error:.2%}")
    told = f"true {error:.2%} in {seconds:.1f} s"
    met = bool(found[-1].summary["accuracy"]["met"])
    if met:
        study.target(f"{name}, {element}, {asked:.0%}", f"true error {LEAST * asked:.2%} to {asked:.0%}", told,
                     LEAST * asked <= error <= asked)
    else:
        study.target(f"{name}, {element}, {asked:.0%} with {most:,} elements", "told where not reached",
                     f"{told}: {found[-1].summary['stop_reason']}", not found[-1].converged)
    grows = found[-1].summary["peak_stress"].get("grows")
    if len(meshes) > 2 and name in ENDLESS:
        study.target(f"{name}, {element}, {asked:.0%}: largest stress", f"grows as h^-{ENDLESS[name]:.2f}" if ENDLESS[name] else "has a limit",
                     f"grows as h^-{grows:.2f}" if grows else "not told to grow", bool(grows) == bool(ENDLESS[name]))
    if uniform:
        _beside(study, f"{name}, {element}, {asked:.0%}", name in REGULAR, seconds, error, uniform)
    return met


def _beside(study: Study, what: str, regular: bool, seconds: float, error: float, uniform: list[tuple[float, float]]) -> None:
    """Seconds of uniform meshes with the same true error, by powers between those that were solved on, or of the best of them."""
    best, longest = min(uniform)
    reached = error >= best
    errors, logs = np.log(np.array(sorted(uniform))).T
    beside = float(np.exp(np.interp(math.log(error), errors, logs))) if reached else longest
    told = f"{beside / seconds:.2f}: {beside:.1f} / {seconds:.1f} s" + (f", which leave {best:.2%}, not {error:.2%}" if not reached else "")
    least = 1 / HARDLY_MORE if regular else FEWER
    study.target(f"{what}: seconds of a uniform mesh with the same true error over its own", f"at least {least:.2f}", told,
                 beside >= least * seconds)


def _rate(study: Study, name: str, element: str) -> None:
    """How fast true errors fall over all meshes that were graded, and which share of them was estimated at every one."""
    rows = [row for row in study.rows if (row["case"], row["element"]) == (name, element) and row["mesh"] != "uniform"]
    counts, errors = (np.log([row[key] for row in rows]) for key in ("elements", "true_error"))
    if np.ptp(counts):  # one mesh has no rate
        rate, aim = -np.polyfit(counts, errors, 1)[0], {"P1": 1, "P2": 2}[element] / 3
        best = min(aim, EXPONENT.get(name, aim))
        beside = f"; {best:.2f} is the most that tets as long as thick attain" if best < aim else ""
        study.target(f"{name}, {element}: true error falls as N^-s", f"s = {aim:.2f}, nine tenths of it{beside}", f"{rate:.2f}",
                     rate >= 0.9 * best)
    shares = [row["effectivity"] for row in rows]
    study.target(f"{name}, {element}: estimated over true, all meshes", "0.7 to 1.5", f"{min(shares):.2f} to {max(shares):.2f}",
                 0.7 <= min(shares) and max(shares) <= 1.5)


def _picture(study: Study, settings: Settings):
    """A panel a case: true errors over elements, filled marks on graded meshes, hollow ones on uniform ones; crosses are estimates."""
    figure, axes = panels(1, len(settings.cases), (3.6 * len(settings.cases) + 0.6, 3.8))
    for panel, name in zip(axes[0], settings.cases):
        for element, colour in zip(settings.elements, (ORANGE, BLUE)):
            for uniform in (False, True):
                rows = sorted((row for row in study.rows if (row["case"], row["element"], row["mesh"] == "uniform")
                               == (name, element, uniform)), key=lambda row: row["elements"])
                counts = [row["elements"] for row in rows]
                panel.loglog(counts, [row["true_error"] for row in rows], "o", color=colour, markersize=5,
                             label=element + ", uniform" * uniform, markerfacecolor="none" if uniform else colour)
                panel.loglog(counts, [row["estimated"] for row in rows], "x", color=GREY, markersize=4, zorder=1)
        panel.set_title(name, fontsize=11)
        panel.set_xlabel("elements", fontsize=9)
        plain_ticks(panel)
        panel.set_xticks([1e3, 1e4, 1e5])
    axes[0, 0].set_ylabel("true error, energy norm; crosses: estimated", fontsize=9)
    return figure
