"""Limit loads beside theory: belts, wedges, arches, inclines, stacks of boxes, shafts; each carried below, and told above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import bisect, linprog

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.monolithic import Monolithic
from benchmarks.problems.limits import arch, belt, belt_limit, incline, shaft, stack, stack_limit, wedge, wedge_limit
from orchestrator import build_scene, config_from, solve

TOLERANCE, MOST = 1e-4, 2000  # law residual, iterations
BELTS = (0.5, 0.7, 0.9, 0.95, 0.99, 1.01, 1.05, 1.1, 1.3, 1.6)
Scene = Callable[[Path], dict[str, Any]]


def thinnest(voussoirs: int) -> float:
    """Thickness over mean radius of the thinnest semicircular arch of so many stones that stands under its weight, if none slides:
    where a line of thrust stays within every joint (Heyman 1969). Stones are loads at their centres of gravity."""
    def spare(thickness: float) -> float:
        """How far such a line stays from the edges of the joints at best."""
        inner, outer = 1 - thickness / 2, 1 + thickness / 2
        step = np.pi / voussoirs
        reach = np.sin(step / 2) / (step / 2) * 2 / 3 * (outer**3 - inner**3) / (outer**2 - inner**2)
        moments = np.r_[0.0, np.cumsum(reach * np.cos(step * (np.arange(voussoirs) + 0.5)))]  # of the weights about the centre
        joint, turn = np.arange(voussoirs + 1), step * np.arange(voussoirs + 1)
        # unknown: force (H, V) and moment M at the first springing, and what is spare; N across each joint, at the radius (M − moments)/N
        N, M, one = np.column_stack([-np.sin(turn), np.cos(turn), 0 * turn, 0 * turn]), np.array([0, 0, 1, 0]), np.array([0, 0, 0, 1])
        given = -joint * np.cos(turn)
        rows = np.vstack([inner * N - M + one, M - outer * N + one])
        found = linprog([0, 0, 0, -1], A_ub=rows, b_ub=np.r_[-moments - inner * given, moments + outer * given], bounds=[(None, None)] * 4)
        return found.x[3] if found.status == 0 else -1.0

    return bisect(spare, 0.05, 0.2, xtol=1e-6)


def holds(folder: Path, friction: float = 0.2) -> float:
    """What friction holds of a shaft: that times the force by which its press fit, on the same mesh, presses."""
    pressed = solve(config_from({**shaft(folder, 0.0), "method": {"tolerance": {"law": TOLERANCE}}})).interfaces
    return friction * float(pressed.pressure[0] @ pressed.area)


def jams(folder: Path) -> float:
    """The pull over the press load at which a wedge that was pressed and let go comes out, of the same mesh solved in one piece: between
    the largest with a solution that Newton's method finds and the next, which has none, a five-hundredth of the rigid one's apart.

    A rigid wedge holds more: an elastic one gives up a part of its pressure when it is let go and pulled.
    """
    def stands(share: float) -> bool:
        scene = build_scene(config_from(wedge(folder, pull=share * wedge_limit())))
        return Monolithic(scene).solve()[-1].converged

    below, above = 0.5, 1.0
    while above - below > 1 / 500:
        middle = (below + above) / 2
        below, above = (middle, above) if stands(middle) else (below, middle)
    return (below + above) / 2 * wedge_limit()


def scenes(folder: Path) -> Iterator[tuple[str, float, Scene]]:
    """What it is, its load over what theory says is the limit, and the scene."""
    for share in BELTS:
        yield "belt", share, partial(belt, ratio=share * belt_limit(0.2))
    jammed = jams(folder)
    for share in (0.025, 0.1, 0.5, 0.9, 0.99, 1.01, 1.5):
        yield "wedge", share, partial(wedge, pull=share * jammed)
    held = holds(folder)
    for share in (0.005, 0.5, 0.99, 1.01, 1.1, 2.0):
        yield "shaft in a ring", share, partial(shaft, pull=share * held)
    least = thinnest(15)
    for thick in (0.8, 0.99, 1.01, 1.3):
        yield "arch", 1 / thick, partial(arch, thickness=thick * least, voussoirs=15)
    for share in (0.5, 0.99, 1.01, 2.0):
        yield "incline beside a press fit", share, partial(incline, share=share)
    for friction in (0.3, 0.6):
        for share in (0.5, 0.99, 1.01, 2.0):
            kind = "slide" if friction == stack_limit(friction) else "tip over"
            yield f"five boxes that {kind}", share, partial(stack, push=share * stack_limit(friction), friction=friction)


def run(study: Study) -> None:
    """All scenes, from below their limits to above."""
    study.columns = ("scene", "share", "expected", "stop_reason", "iterations", "moves", "pressures", "seconds")
    for number, (name, share, scene) in enumerate(scenes(study.folder)):
        folder = study.folder / f"{number:02d}"  # each has a mesh of its own
        folder.mkdir(exist_ok=True)
        case = Case({**scene(folder), "method": {"tolerance": {"law": TOLERANCE}, "max_iterations": MOST}},
                    {"scene": name, "share": round(share, 3)})
        solved = solve(config_from(dict(case.config)), study.scene(case.config))
        found = solved.summary["limit_load"]
        expected = "converged" if share < 1 else "limit load"
        study.add(case, {"expected": expected, "stop_reason": solved.stop_reason, "iterations": solved.iterations,
                         "moves": found[0]["motions"][0]["body"] if found else "", "pressures": bool(found) and found[0]["pressures"],
                         "seconds": round(solved.summary["timing"]["total"], 1)}, solved.history, solved.stop_reason)
        study.target(f"{name} at {share:.3g} of its limit", expected, solved.stop_reason, solved.stop_reason == expected)
    study.figure(picture(study.rows))


def picture(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Scenes over their loads."""
    names = list(dict.fromkeys(row["scene"] for row in rows))
    figure, ((axes,),) = panels(size=(7.5, 3.5))
    for row in rows:
        carried, right = row["stop_reason"] == "converged", row["stop_reason"] == row["expected"]
        axes.plot(float(row["share"]), names.index(row["scene"]), "o" if carried else "x",
                  color=(BLUE if carried else ORANGE) if right else "red")
    axes.axvline(1.0, color=GREY, linewidth=1, linestyle="--")
    axes.set_yticks(range(len(names)), names)
    axes.set(xscale="log", xlabel="load over the limit of theory")
    axes.set_title("Circles: carried; crosses: limit load; red: another end than theory's", fontsize=11)
    return figure
