"""The same scenes through several codes and transports, alone and mixed: do they agree, and what does each cost?"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.blackbox.diagnosis import difference
from orchestrator.config import config_from, load_config
from orchestrator.results.figures.codes import PALETTE
from orchestrator.results.figures.plotting import new_figure, png, tidy
from orchestrator.results.solution import Solution
from orchestrator.results.summary.codes import code_label
from orchestrator.run import solve
from benchmarks.kit.study import Case, Study
from benchmarks.problems.assemblies import stack_of_three
from benchmarks.problems.cases import cube
from orchestrator.timing import Stopwatch

ROOT = Path(__file__).resolve().parents[2]
OWN = str(ROOT / "orchestrator" / "blackbox" / "codes" / "template.py")
SAME, RESULTANTS = 1e-8, 1e-6
ALONE: dict[str, Any] = {
    "FreeFEM, pipe": {"code": "freefem"}, "FreeFEM, file": {"code": "freefem", "transport": "file"},
    "CalculiX, file": {"code": "calculix"}, "scikit-fem, pipe": {"code": "scikit-fem"},
    "scikit-fem, file": {"code": "scikit-fem", "transport": "file"}, "the template, pipe": {"code": OWN},
}
MIXED = [{"code": "freefem"}, {"code": "freefem", "transport": "file", "on": "block 0-0-1"},
         {"code": "calculix", "on": ["block 1-0-*"]}, {"code": "scikit-fem", "on": "block 0-1-*"},
         {"code": OWN, "on": "block 1-1-1"}]
APART = [{"code": "freefem"}, {"code": "calculix", "on": "mid"}, {"code": "scikit-fem", "on": "top"}]
PUNCH = {"FreeFEM on FreeFEM": {"code": "freefem"},
         "FreeFEM on CalculiX": [{"code": "freefem"}, {"code": "calculix", "on": "block"}],
         "CalculiX on FreeFEM": [{"code": "calculix"}, {"code": "freefem", "on": "block"}]}


Spent = list[tuple[str, dict[str, float]]]  # case, seconds by code


def run(study: Study, elements: int = 5) -> None:
    """Eight cubes bonded, bent and pulled; a punch pressed and sheared on a block with friction; three blocks meshed apart.

    Parameters
    ----------
    elements : along the edge of a cube
    """
    study.columns = ("scene", "codes", "iterations", "difference", "resultants", "statuses", "code_seconds",
                     "orchestrator_seconds", "unit_loads", "stop_reason", "seconds")
    spent: Spent = []
    first: Solution | None = None
    for name, blackbox in {**ALONE, "mixed": MIXED}.items():
        solved = _solve(study, "eight cubes", name, {**cube(2, elements), "blackbox": blackbox}, first, spent)
        if first is not None:
            apart = study.rows[-1]["difference"]
            study.target(f"eight cubes, {name}", f"displacements of FreeFEM through pipes to {SAME:g}", f"{apart:.1e}",
                         apart <= SAME)
        first = first or solved
    first, punch = None, load_config(ROOT / "configs" / "punch.yaml").config.complete()
    for name, blackbox in PUNCH.items():
        solved = _solve(study, "punch", name, {**punch, "blackbox": blackbox}, first, spent)
        if first is not None:
            row = study.rows[-1]
            study.target(f"punch, {name}", f"the same statuses, resultants to {RESULTANTS:g}",
                         f"{row['statuses']} of other status, {row['resultants']:.1e}",
                         row["statuses"] == 0 and row["resultants"] <= RESULTANTS)
        first = first or solved
    for scene, friction in (("meshed apart, bonded", None), ("meshed apart, friction", 0.3)):
        problem = {**stack_of_three(friction), "method": {"tolerance": {"error": SAME / 10}}}
        first = _solve(study, scene, "FreeFEM", {**problem, "blackbox": APART[0]}, None, spent)
        _solve(study, scene, "FreeFEM, CalculiX, scikit-fem", {**problem, "blackbox": APART}, first, spent)
        row = study.rows[-1]
        study.target(f"{scene}, three codes", f"the same statuses, displacements of FreeFEM alone to {SAME:g}",
                     f"{row['statuses'] or 0} of other status, {row['difference']:.1e}",
                     not row["statuses"] and row["difference"] <= SAME)
    study.figure(_picture(spent))


def _solve(study: Study, scene: str, name: str, data: Mapping[str, Any], first: Solution | None,
           spent: Spent) -> Solution:
    """Solve, and compare with the first case of the scene."""
    watch, config = Stopwatch(), config_from(dict(data))
    with study.console.status(name):
        solved = solve(config, study.scene(data), watch=watch)
    summary, base = solved.summary, first or solved
    row = {"iterations": solved.iterations, "stop_reason": solved.stop_reason,
           "difference": difference(solved.displacement, base.displacement),
           "resultants": difference(np.array(summary["reactions"]), np.array(base.summary["reactions"])),
           "statuses": solved.interfaces and int((solved.interfaces.status != base.interfaces.status).sum()),
           "code_seconds": ", ".join(f"{code_label(c)} {c['seconds']['total']:.2f}" for c in summary["codes"]),
           "orchestrator_seconds": round(watch.total - summary["asking_seconds"], 2),
           "unit_loads": sum(note["unit_loads"] for c in summary["codes"] for note in c["compliances"]),
           "seconds": round(watch.total, 2)}
    study.add(Case(data, {"scene": scene, "codes": name}), row, solved.iterated.history,
              f"{row['difference']:.1e} from the first")
    spent.append((f"{scene}: {name}", {**{code_label(c): c["seconds"]["total"] for c in summary["codes"]},
                                       "orchestrator": row["orchestrator_seconds"]}))
    return solved


def _picture(spent: Spent) -> bytes:
    """CPU seconds of each code and wall-clock seconds of the orchestrator, case by case."""
    names = list(dict.fromkeys(n for _, parts in spent for n in parts if n != "orchestrator"))
    colours = {n: PALETTE[i % len(PALETTE)] for i, n in enumerate(names)} | {"orchestrator": (0.55, 0.55, 0.55)}
    figure = new_figure(8.4, 0.34 * len(spent) + 1.6)
    axes = figure.subplots()
    for place, (_, parts) in enumerate(spent):
        left = 0.0
        for name, seconds in parts.items():
            axes.barh(place, seconds, left=left, color=colours[name])
            left += seconds
    axes.set_yticks(range(len(spent)), [name for name, _ in spent], fontsize=8.5)
    axes.invert_yaxis()
    for name, colour in colours.items():
        axes.barh(0, 0, color=colour, label=name)
    axes.set_xlabel("seconds: of CPU in each code, of wall clock in the orchestrator")
    tidy(axes)
    axes.legend(fontsize=8, frameon=False)
    figure.tight_layout()
    return png(figure)
