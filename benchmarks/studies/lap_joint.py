"""A lap joint of two bolts, from two CAD files: tightened, pulled until it slips; by hand and beside CalculiX on the same mesh."""

from __future__ import annotations

import numpy as np

from benchmarks.kit.calculix_contact import contact_forces
from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems.lap_joint import FRICTION, PRETENSION, PULL, joint_scene
from orchestrator import config_from, solve

AGREE = 0.03
FINER = (18, 4.0, 2.8)  # elements on which the shortening is compared: it hangs on what contact does to the mesh
FACTORS = (0.25, 0.5, 0.75, 1.0)
PLATES = ("plates/lower", "plates/upper")


def run(study: Study) -> None:
    """One mesh of four-node tets, five load steps; the first of them on a finer one, too."""
    study.columns = ("dofs", "iterations", "stop_reason", "slips_at", "calculix_slips_at", "shortening",
                     "calculix_shortening", "seconds")
    config = joint_scene(study.folder, FACTORS)
    solved = solve(config_from(config))
    exact, summary = contact_forces(solved.scene, study.folder / "calculix"), solved.summary
    face = next(face for face in summary["contact_faces"] if tuple(face["bodies"]) == PLATES)
    used = exact.friction[PLATES] / (FRICTION * exact.normal[PLATES])
    theirs = slip_by_line(used)
    study.add(Case(config, {"element": "P1"}), {
        "dofs": summary["dofs"], "iterations": solved.iterations, "stop_reason": solved.stop_reason,
        "slips_at": face["slips"] and face["slips"]["at"], "calculix_slips_at": theirs,
        "shortening": float(np.mean([b["shortening"][0] for b in summary["bolts"]])),
        "calculix_shortening": float(exact.shortening[0].mean()),
        "seconds": round(summary["timing"]["total"], 1)},
        solved.history, f"slips at {face['slips'] and face['slips']['at']}")
    heads = [exact.normal[bolt["name"], PLATES[1]] for bolt in summary["bolts"]]
    for what, mine, other in (
            ("preload shortening, mean of the bolts", *_tightened(study)),
            ("slip load", face["slips"]["at"], theirs),
            *((f"force of {b['name']} at {factor * PULL:,.0f}", b["force"][k], head[k]) for k, factor in enumerate(FACTORS, 1) if k != 3
              for b, head in zip(summary["bolts"], heads))):
        study.target(f"{what}, beside CalculiX", f"within {AGREE:.0%}", f"{mine:.6g}, {other:.6g}", abs(mine / other - 1) <= AGREE)
    least, most = (FRICTION * 2 * force for force in (min(b["force"][-1] for b in summary["bolts"]), PRETENSION))
    by_bolts = sum(b["shear"][-1] for b in summary["bolts"])
    study.target("slip load by hand: friction of the faying face, what bent bolts carry on top", f"{least:,.0f} to {most + by_bolts:,.0f}",
                 f"{face['slips']['at']:,.0f}", least <= face["slips"]["at"] <= most + by_bolts)
    study.figure(_picture(face, used))


def _tightened(study: Study) -> tuple[float, float]:
    """Shortening, the mean of the bolts, here and by CalculiX, on the finer mesh."""
    config = joint_scene(study.folder, (), FINER)
    solved = solve(config_from(config))
    exact = contact_forces(solved.scene, study.folder / "calculix").shortening[0]
    mine = [b["shortening"][0] for b in solved.summary["bolts"]]
    study.add(Case(config, {"element": "P1, tightened"}), {
        "dofs": solved.summary["dofs"], "iterations": solved.iterations, "stop_reason": solved.stop_reason,
        "seconds": round(solved.summary["timing"]["total"], 1)}, solved.history, f"shortened by {np.mean(mine):.5g}")
    return float(np.mean(mine)), float(exact.mean())


def slip_by_line(used: np.ndarray) -> float:
    """Load at which the share of friction used, of the load steps, reaches 1, by a straight line through the last two that stick."""
    loads = PULL * np.array([0.0, *FACTORS])
    last = int(np.argmax(used > 0.99)) - 1
    return float(loads[last] + (1 - used[last]) * (loads[last] - loads[last - 1]) / (used[last] - used[last - 1]))


def _picture(face: dict, used: np.ndarray):
    figure, ((axes,),) = panels(size=(6.0, 3.5))
    loads = PULL / 1e3 * np.array([0.0, *FACTORS])
    axes.plot(loads, face["used"], "o-", color=BLUE, markersize=3, linewidth=0.8, label="orchestrator")
    axes.plot(loads, used, "s--", color=ORANGE, markersize=3, linewidth=0.8, label="CalculiX")
    axes.set(xlabel="pull, kN", ylabel="friction used of the faying face", title="A lap joint of two bolts")
    axes.legend()
    return figure
