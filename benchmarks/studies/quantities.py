"""``accuracy: …`` at a probe beside the probe's true errors, and beside the same accuracy asked of the whole field in the energy norm.

Displacements of an L's heel and end and of a plate with a hole, at a point and on a face, and what a punch presses with. True errors are
distances from a solution that is asked for a tenth of the smallest accuracy. Seconds are of the processor, all processes together.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import PositiveFloat, PositiveInt

from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.studies.accuracy import graded, problem
from orchestrator import Solution

FEWER = 5.0  # times the seconds that the whole field takes
FINEST = 0.1  # of the accuracy asked for: what the reference is asked for
PROBES: dict[tuple[str, str], dict[str, Any]] = {
    ("l_shape", "heel"): {"at": [0.25, 0.125, 0.5]}, ("l_shape", "end"): {"at": [1, 0.125, 0.25]},
    ("hole", "side"): {"at": [0.5, 1, 0.1]}, ("hole", "end"): {"on": {"plane": "x", "at": 1}},
    ("punch", "seat"): {"on": {"plane": "z", "at": 0}, "quantity": "resultant"}}


class Settings(Keys):
    """What to solve."""

    probes: list[str] = [" ".join(name) for name in PROBES]
    element: str = "P2"
    asked: list[PositiveFloat] = [0.03, 0.01]
    elements: PositiveInt = 40_000  # most tets of the whole field's meshes
    reference: PositiveInt = 15_000


def run(study: Study, settings: Settings = Settings()) -> None:
    """Every accuracy of every probe, and of the field that it is a probe of."""
    study.columns = ("case", "probe", "asked", "elements", "told", "true_error", "seconds", "by_energy", "its_elements", "its_seconds",
                     "times")
    fields: dict[tuple[str, float], tuple[Solution, float]] = {}
    for case, name in map(str.split, settings.probes):
        probe = {"name": name, **PROBES[case, name]}
        finest = FINEST * min(settings.asked)
        exact, _ = _run(study, case, settings.element, {**probe, "accuracy": finest}, {"elements": settings.reference})
        for asked in sorted(settings.asked, reverse=True):
            if (case, asked) not in fields:
                fields[case, asked] = _run(study, case, settings.element, None, {"error": asked, "elements": settings.elements})
            _row(study, (case, name, asked), _run(study, case, settings.element, {**probe, "accuracy": asked}, {}), fields[case, asked], exact)
    study.figure(_picture(study))


def _run(study: Study, case: str, element: str, probe: Mapping[str, Any] | None, accuracy: Mapping[str, Any]) -> tuple[Solution, float]:
    """The solution on the last mesh, and seconds of the processor, results written and all."""
    made = problem(study.folder, case, element)
    made = {**made, "name": "run", "output": {**made["output"], "probes": [dict(probe)] if probe else []}}
    found, seconds = graded(study, made, {"accuracy": accuracy})
    return found[-1], seconds


def _value(solution: Solution) -> np.ndarray:
    """(3,) of the probe, at the last load step."""
    values = solution.summary["probes"][0]["values"]
    names = ("ux", "uy", "uz") if "ux" in values else ("fx", "fy", "fz")
    return np.array([values[name][-1] for name in names])


def _row(study: Study, of: tuple[str, str, float], own: tuple[Solution, float], field: tuple[Solution, float], exact: Solution) -> None:
    case, name, asked = of
    (solution, seconds), (whole, longer) = own, field
    true = float(np.linalg.norm(_value(solution) - _value(exact)) / np.linalg.norm(_value(exact)))
    told, reached = solution.summary["probes"][0]["accuracy"]["error"], whole.summary["accuracy"]
    study.note({"case": case, "probe": name, "asked": asked, "elements": len(solution.scene.mesh.cells), "told": told, "true_error": true,
                "seconds": round(seconds, 1), "by_energy": "reached" if reached["met"] else f"{reached['reached']:.1%}, not reached",
                "its_elements": len(whole.scene.mesh.cells), "its_seconds": round(longer, 1), "times": round(longer / seconds, 1)},
               f"{case}, {name}, {asked:.1%}: true {true:.2%} in {seconds:.1f} s; the whole field {longer:.1f} s"
               + ("" if reached["met"] else f", {reached['reached']:.1%}"))
    study.target(f"{case}, {name}: true error", f"at most {asked:.1%}", f"{true:.2%}", true <= asked)
    study.target(f"{case}, {name}, {asked:.1%}: seconds of the whole field over the probe's", f"at least {FEWER:.0f}",
                 f"{longer / seconds:.1f}" + ("" if reached["met"] else " at least: not reached"), longer >= FEWER * seconds)


def _picture(study: Study):
    """Seconds of the probe's runs and of the whole field's."""
    figure, axes = panels(1, 1, (7.0, 3.6))
    panel, rows = axes[0, 0], study.rows
    places = np.arange(len(rows))
    panel.bar(places - 0.2, [row["seconds"] for row in rows], 0.4, color=ORANGE, label="the probe")
    panel.bar(places + 0.2, [row["its_seconds"] for row in rows], 0.4, color=BLUE, label="the whole field, energy norm")
    panel.set_yscale("log")
    panel.set_xticks(places, [f"{row['case']}\n{row['probe']}\n{row['asked']:.0%}" for row in rows], fontsize=8)
    panel.set_ylabel("seconds to the accuracy asked for", fontsize=9)
    panel.legend(fontsize=8)
    return figure
