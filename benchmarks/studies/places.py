"""How far bodies may be off their places, beside how far they are: crowds of grains, against solutions in one piece.

Grains are pressed and sheared between two plates, and some of them are held by others alone. What a run tells of each body's place is
compared with the largest distance of its nodes from where the nearest exact solution has them, all over the largest displacement. Every
scene is solved to an energy error, and to a law residual of the same value. A body that is told to have no place may be anywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.settings import RandomScenes
from benchmarks.kit.study import Study
from benchmarks.kit.truth import nearest, solved_in
from benchmarks.problems.cases import with_method
from benchmarks.problems.random_contact import crowd

LEAST = 0.3  # of what is told over what is true
FAR, NAMED = 10.0, 3.0  # tolerances: by which no body may be off that a run does not name, and from which on it does
COUNTS = 1e-2  # of the tolerance: how far a body has to be off to count
CRITERIA = ("error", "law")


def run(study: Study, settings: RandomScenes = RandomScenes()) -> None:
    """All scenes, by both criteria."""
    study.columns = ("scene", "criterion", "bodies", "loose", "friction", "contrast", "steps", "asked", "iterations", "stop_reason",
                     "ratio", "missed", "undetermined", "seconds")
    bodies: dict[str, list] = {criterion: [] for criterion in CRITERIA}
    for number in range(settings.first, settings.first + settings.scenes):
        data, labels = crowd(number, settings.code)
        for criterion in CRITERIA:
            asked = with_method(data, {**data["method"], "tolerance": {criterion: labels["asked"]}})
            row = {"scene": number, "criterion": criterion, **labels,
                   **study.kept(f"scene-{number}-{criterion}", asked, lambda: compared(asked, labels["asked"]))}
            each = row.pop("each", [])
            row["missed"] = sum(true > FAR and told <= NAMED for told, true in each)
            bodies[criterion] += each
            study.note(row, f"scene {number}, {criterion} {labels['asked']:g}, friction {labels['friction']:g}: " + (
                f"failed, {row['failure']}" if "failure" in row else f"{row['stop_reason']} after {row['iterations']}, told over true "
                f"{row['ratio']:.2g} at least, {row['missed']} missed, {row['undetermined']} without a place"))
    study.figure(_picture(bodies))
    judge(study)


def compared(data: Mapping[str, Any], asked: float) -> dict[str, Any]:
    """Columns of a run, and of each body how far it may be off, infinite for any way, and how far it is, over the tolerance."""
    if isinstance(run := solved_in(data), str):
        return {"failure": run}
    scene, solved, seconds = run
    row = {"bodies": len(scene.subdomains), "loose": sum(not s.fixed.any() for s in scene.subdomains), "iterations": solved.iterations,
           "stop_reason": solved.stop_reason, "seconds": round(seconds, 2), "ratio": float("nan"), "undetermined": 0, "each": []}
    truth, _ = nearest(scene, solved.sides, asked)
    if truth is None or not solved.summary["places"]:
        return row
    size, told = max(np.abs(u).max() for u in solved.sides) * asked, solved.summary["places"]["bodies"]
    each = np.array([(told[s.body] / asked, np.linalg.norm(u - exact, axis=2).max() / size)
                     for s, u, exact in zip(scene.subdomains, solved.sides, truth.parts)])
    known = each[np.isfinite(each[:, 0]) & (each[:, 1] > COUNTS)]
    return {**row, "ratio": float((known[:, 0] / known[:, 1]).min(initial=np.inf)), "each": each.tolist(),
            "undetermined": int(np.isinf(each[:, 0]).sum())}


def judge(study: Study) -> None:
    """The targets, of what has been run."""
    for criterion in CRITERIA:
        rows = [row for row in study.rows if row["criterion"] == criterion and np.isfinite(row.get("ratio", np.nan))]
        ratios, missed = np.array([row["ratio"] for row in rows]), sum(row["missed"] for row in rows)
        if len(rows):
            study.target(f"{criterion}: told over true, the least body of each scene", f"at least {LEAST:g}",
                         f"{ratios.min():.2f}, median {np.median(ratios):.2f}, of {len(rows)} scenes", ratios.min() >= LEAST)
            study.target(f"{criterion}: bodies off by more than {FAR:g} tolerances that are not named", "0", missed, missed == 0)
            undetermined, all_of = (sum(row[key] for row in rows) for key in ("undetermined", "bodies"))
            study.target(f"{criterion}: bodies without a place", "told", f"{undetermined} of {all_of}", True)


def _picture(bodies: Mapping[str, list]):
    """What is told over what is true, body by body."""
    figure, ((axes,),) = panels(size=(6.4, 5.0))
    for (criterion, each), colour in zip(bodies.items(), (BLUE, ORANGE)):
        told, true = np.array(each).reshape(-1, 2).T
        axes.loglog(true, np.where(np.isfinite(told), told, np.nan), ".", color=colour, markersize=4, label=criterion)
    ends = np.array([COUNTS, 1e4])
    axes.loglog(ends, LEAST * ends, "--", color=GREY, linewidth=1)
    axes.set(xlabel="distance from its place, tolerances", ylabel="told, tolerances")
    axes.set_title("a dot a body; dashed: three tenths of the truth", fontsize=10, color=GREY)
    axes.legend()
    return figure
