"""Eight bolts tightened in two rounds, locked and pulled, beside CalculiX's pre-tension sections on the same mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orchestrator.config import config_from
from orchestrator.results.figures.plotting import BLUE, ORANGE, new_figure, png, tidy
from orchestrator.run import solve
from benchmarks.kit.calculix_whole import displacements
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bolted_rings import bolted_rings, force, pulls

COLUMNS = ("element", "dofs", "iterations", "law_residual", "stop_reason", "difference", "force_error", "seconds")
AGREE, EXACT = 1e-6, 1e-3


def run(study: Study) -> None:
    """Both elements, everything bonded."""
    study.columns = COLUMNS
    folder = Path(study.folder.path)
    problem, forces = bolted_rings(folder), {}
    for element in ("P1", "P2"):
        solved = solve(config_from({**problem, "blackbox": {"code": "freefem", "element": element},
                                    "method": {"tolerance": {"error": 1e-8}}}))
        beside = folder / f"calculix-{element}"
        beside.mkdir(exist_ok=True)
        exact = displacements(solved.scene, beside, pulls())
        cuts = np.concatenate([bolt.interface.global_nodes for bolt in solved.scene.bolts])
        off = np.delete(np.abs(exact - solved.displacement), cuts, axis=1).max() / np.abs(exact).max()
        forces[element] = np.array([bolt["force"] for bolt in solved.summary["bolts"]])
        given = [(forces[element][k, t], pull) for k, row in enumerate(pulls()) for t, pull in enumerate(row) if pull is not None]
        residual = solved.summary["residuals"]["law_residual"]
        study.add(Case({}, {"element": element}), {
            "dofs": solved.summary["dofs"], "stop_reason": solved.stop_reason, "iterations": solved.iterations, "law_residual": residual, "difference": float(off),
            "force_error": max(abs(found / pull - 1) for found, pull in given),
            "seconds": round(solved.summary["timing"]["total"], 1)}, solved.iterated.history, f"law residual {residual:.1e}")
        row = study.rows[-1]
        study.target(f"{element}: displacements at three load steps, beside CalculiX", f"within {AGREE:g} of the largest",
                     f"{row['difference']:.1e}", row["difference"] <= AGREE)
        study.target(f"{element}: forces of bolts that are being tightened", f"within {EXACT:.1%}", f"{row['force_error']:.1e}",
                     row["force_error"] <= EXACT)
    study.figure(_picture(forces))


def _picture(forces: dict[str, np.ndarray]) -> bytes:
    figure = new_figure(7.0, 3.5)
    axes = figure.subplots()
    for (element, found), colour in zip(forces.items(), (BLUE, ORANGE)):
        for k, row in enumerate(found):
            axes.plot(range(1, len(row) + 1), row / force(k + 1), "o-", color=colour, linewidth=0.8, markersize=3,
                      label=element if k == 0 else None)
    axes.set_xticks([1, 2, 3], ["first round", "second round", "pulled"])
    axes.set(ylabel="force / pretension")
    axes.set_title("Eight bolts, tightened in two rounds", fontsize=11)
    tidy(axes)
    axes.legend(fontsize=9, frameon=False)
    figure.tight_layout()
    return png(figure)
