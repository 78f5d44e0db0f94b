"""Eight bolts tightened in two rounds, locked and pulled, beside CalculiX's pre-tension sections on the same mesh."""

from __future__ import annotations

import numpy as np

from benchmarks.kit.calculix_whole import displacements
from benchmarks.kit.drawing import BLUE, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bolted_rings import bolted_rings, force, pulls
from orchestrator import config_from, solve

AGREE, EXACT = 1e-6, 1e-3


def run(study: Study) -> None:
    """Both elements, everything bonded."""
    study.columns = ("element", "dofs", "iterations", "law_residual", "stop_reason", "difference", "force_error", "seconds")
    problem = bolted_rings(study.folder)
    figure, ((axes,),) = panels(size=(7.0, 3.5))
    for element, colour in (("P1", BLUE), ("P2", ORANGE)):
        config = {**problem, "blackbox": {"code": "freefem", "element": element}, "method": {"tolerance": {"error": 1e-8}}}
        solved = solve(config_from(config))
        beside = study.folder / f"calculix-{element}"
        beside.mkdir(exist_ok=True)
        exact = displacements(solved.scene, beside, pulls())
        cuts = np.concatenate([bolt.interface.global_nodes for bolt in solved.scene.bolts])
        off = np.delete(np.abs(exact - solved.displacement), cuts, axis=1).max() / np.abs(exact).max()
        forces, summary = [bolt["force"] for bolt in solved.summary["bolts"]], solved.summary
        wrong = max(abs(forces[k][t] / pull - 1) for k, row in enumerate(pulls()) for t, pull in enumerate(row) if pull is not None)
        residual = summary["residuals"]["law_residual"]
        study.add(Case(config, {"element": element}), {
            "dofs": summary["dofs"], "stop_reason": solved.stop_reason, "iterations": solved.iterations, "law_residual": residual,
            "difference": float(off), "force_error": wrong, "seconds": round(summary["timing"]["total"], 1)},
            solved.history, f"law residual {residual:.1e}")
        study.target(f"{element}: displacements at three load steps, beside CalculiX", f"within {AGREE:g} of the largest",
                     f"{off:.1e}", off <= AGREE)
        study.target(f"{element}: forces of bolts that are being tightened", f"within {EXACT:.1%}", f"{wrong:.1e}", wrong <= EXACT)
        for k, found in enumerate(forces):
            axes.plot([1, 2, 3], np.array(found) / force(k + 1), "o-", color=colour, linewidth=0.8, markersize=3,
                      label="" if k else element)
    axes.set_xticks([1, 2, 3], ["first round", "second round", "pulled"])
    axes.set(ylabel="force / pretension", title="Eight bolts, tightened in two rounds")
    study.figure(figure)
