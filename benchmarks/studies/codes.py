"""The same scenes through several codes and transports, alone and mixed: do they agree, and what does each cost?"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kit.drawing import GREY, PALETTE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems.assemblies import stack_of_three
from benchmarks.problems.cases import cube
from orchestrator import Solution, config_from, load_config, solve

ROOT = Path(__file__).resolve().parents[2]
OWN = str(ROOT / "orchestrator" / "blackbox" / "codes" / "template.py")
SAME, RESULTANTS = 1e-8, 1e-6
ALONE: dict[str, Any] = {
    "FreeFEM, pipe": {"code": "freefem"}, "FreeFEM, file": {"code": "freefem", "transport": "file"},
    "CalculiX, file": {"code": "calculix"}, "scikit-fem, pipe": {"code": "scikit-fem"},
    "scikit-fem, file": {"code": "scikit-fem", "transport": "file"}, "the template, pipe": {"code": OWN},
    "five in one run": [{"code": "freefem"}, {"code": "freefem", "transport": "file", "on": "block 0-0-1"},
                        {"code": "calculix", "on": ["block 1-0-*"]}, {"code": "scikit-fem", "on": "block 0-1-*"},
                        {"code": OWN, "on": "block 1-1-1"}],
}
APART = [{"code": "freefem"}, {"code": "calculix", "on": "mid"}, {"code": "scikit-fem", "on": "top"}]
PUNCH = {"FreeFEM on FreeFEM": {"code": "freefem"},
         "FreeFEM on CalculiX": [{"code": "freefem"}, {"code": "calculix", "on": "block"}],
         "CalculiX on FreeFEM": [{"code": "calculix"}, {"code": "freefem", "on": "block"}]}
TIGHT = {"method": {"tolerance": {"error": SAME / 10}}}


def run(study: Study, elements: int = 5) -> None:
    """Eight cubes bonded, bent and pulled; a punch pressed and sheared on a block with friction; three blocks meshed apart.

    Parameters
    ----------
    elements : along the edge of a cube
    """
    study.columns = ("scene", "codes", "iterations", "difference", "resultants", "statuses", "code_seconds",
                     "orchestrator_seconds", "unit_loads", "stop_reason", "seconds")
    punch = load_config(ROOT / "configs" / "punch.yaml").config.complete()
    three = {"FreeFEM": APART[0], "FreeFEM, CalculiX, scikit-fem": APART}
    spent: list[tuple[str, dict[str, float]]] = []
    for scene, data, codes, wanted in (
            ("eight cubes", cube(2, elements), ALONE, "difference"), ("punch", punch, PUNCH, "resultants"),
            ("meshed apart, bonded", stack_of_three(None) | TIGHT, three, "difference"),
            ("meshed apart, friction", stack_of_three(0.3) | TIGHT, three, "difference")):
        limit, first = SAME if wanted == "difference" else RESULTANTS, None
        for name, blackbox in codes.items():
            solved = _solve(study, scene, name, {**data, "blackbox": blackbox}, first)
            row = study.rows[-1]
            spent.append((f"{scene}: {name}", {**_seconds(solved), "orchestrator": row["orchestrator_seconds"]}))
            if first is not None:
                study.target(f"{scene}, {name}: {wanted} to the first", f"the same statuses, {limit:g}",
                             f"{row['statuses'] or 0} of other status, {row[wanted]:.1e}", not row["statuses"] and row[wanted] <= limit)
            first = first or solved
    study.figure(_picture(spent))


def _solve(study: Study, scene: str, name: str, data: Mapping[str, Any], first: Solution | None) -> Solution:
    """Solve, and compare with the first case of the scene."""
    begin = time.perf_counter()
    with study.console.status(name):
        solved = solve(config_from(dict(data)), study.scene(data))
    seconds, summary, base = time.perf_counter() - begin, solved.summary, first or solved
    row = {"iterations": solved.iterations, "stop_reason": solved.stop_reason,
           "difference": _difference(solved.displacement, base.displacement), "resultants": _difference(solved.reactions, base.reactions),
           "statuses": solved.interfaces and int((solved.interfaces.status != base.interfaces.status).sum()),
           "code_seconds": ", ".join(f"{code} {s:.2f}" for code, s in _seconds(solved).items()),
           "orchestrator_seconds": round(seconds - summary["asking_seconds"], 2),
           "unit_loads": sum(note["unit_loads"] for c in summary["codes"] for note in c["compliances"]), "seconds": round(seconds, 2)}
    study.add(Case(data, {"scene": scene, "codes": name}), row, solved.history, f"{row['difference']:.1e} from the first")
    return solved


def _difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference over the largest entry."""
    return float(np.abs(one - other).max() / np.abs(other).max())


def _seconds(solved: Solution) -> dict[str, float]:
    """CPU seconds of each code, by its name and transport."""
    return {f"{Path(c['code']).name} {c['transport']}": c["seconds"]["total"] for c in solved.summary["codes"]}


def _picture(spent: list[tuple[str, dict[str, float]]]):
    """CPU seconds of each code and wall-clock seconds of the orchestrator, case by case."""
    names = list(dict.fromkeys(name for _, parts in spent for name in parts if name != "orchestrator"))
    colours = {**{name: PALETTE[i % len(PALETTE)] for i, name in enumerate(names)}, "orchestrator": GREY}
    figure, ((axes,),) = panels(size=(8.4, 0.34 * len(spent) + 1.6))
    left = np.zeros(len(spent))
    for name, colour in colours.items():
        width = np.array([parts.get(name, 0.0) for _, parts in spent])
        axes.barh(range(len(spent)), width, left=left, color=colour, label=name)
        left += width
    axes.set_yticks(range(len(spent)), [name for name, _ in spent])
    axes.invert_yaxis()
    axes.set_xlabel("seconds: of CPU in each code, of wall clock in the orchestrator")
    return figure
