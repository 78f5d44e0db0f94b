"""Contact between stiff and soft bodies: iterations over the contrast of their moduli, in both orders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from orchestrator.config import config_from
from orchestrator.results.figures.plotting import BLUE, GREY, ORANGE, new_figure, png, tidy
from orchestrator.run import solve
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import STEEL, contact_defaults, with_method
from benchmarks.problems.punch import punch

STIFF = STEEL[0]["young"]
CONTRASTS = (1, 10, 100, 1000)
TOLERANCE, FACTOR, MOST = 1e-6, 1.3, 40  # of the law residual; iterations over those of equal moduli, and in all
ORDERS = ("soft block", "soft punch")


def run(study: Study) -> None:
    """A punch on a block: equal moduli, then either of them up to a thousand times softer."""
    study.columns = ("softer", "contrast", "iterations", "law_residual", "stop_reason", "seconds")
    for contrast in CONTRASTS:
        for softer in ORDERS if contrast > 1 else ("neither",):
            _solve(study, softer, contrast)
    usual = study.rows[0]["iterations"]
    for row in study.rows[1:]:
        limit = min(int(FACTOR * usual), MOST)
        study.target(f"{row['softer']}, 1:{row['contrast']}, law residual ≤ {TOLERANCE:g}",
                     f"at most {limit} iterations, {FACTOR} times those of equal moduli and {MOST}", row["iterations"],
                     row["stop_reason"] == "converged" and row["iterations"] <= limit)
    study.figure(_picture(study))


def _solve(study: Study, softer: str, contrast: float) -> None:
    moduli = [STIFF / contrast if softer == order else STIFF for order in ORDERS]
    case = Case(with_method(punch(Path(study.folder.path), *moduli), contact_defaults(error=TOLERANCE)),
                {"softer": softer, "contrast": contrast})
    solved = solve(config_from(dict(case.config)), study.scene(case.config))
    row: dict[str, Any] = {"iterations": solved.iterations, "law_residual": solved.summary["residuals"]["law_residual"],
                           "stop_reason": solved.stop_reason, "seconds": round(solved.summary["timing"]["total"], 2)}
    study.add(case, row, solved.iterated.history, f"law residual {row['law_residual']:.1e}")


def _picture(study: Study) -> bytes:
    figure = new_figure(6.4, 4.0)
    axes = figure.subplots()
    usual = study.rows[0]["iterations"]
    for softer, colour, marker in zip(ORDERS, (BLUE, ORANGE), "os"):
        rows = [row for row in study.rows if row["softer"] in (softer, "neither")]
        axes.semilogx([row["contrast"] for row in rows], [row["iterations"] for row in rows], marker + "-", color=colour,
                      label=softer)
    axes.axhline(FACTOR * usual, color=GREY, linewidth=1, linestyle="--")
    axes.set(ylim=(0, None), xlabel="contrast of the moduli", ylabel="iterations")
    axes.set_title(f"Punch on block, μ = 0.2, law residual {TOLERANCE:g}; dashed: {FACTOR} times equal moduli", fontsize=11)
    tidy(axes)
    axes.legend(fontsize=9, frameon=False)
    figure.tight_layout()
    return png(figure)
