"""Contact between stiff and soft bodies: iterations over the contrast of their moduli, in both orders."""

from __future__ import annotations

from benchmarks.kit.drawing import BLUE, GREY, ORANGE, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import STEEL, contact_defaults, with_method
from benchmarks.problems.punch import punch
from orchestrator import config_from, solve

STIFF = STEEL[0]["young"]
CONTRASTS = (1, 10, 100, 1000)
TOLERANCE, FACTOR, MOST = 1e-6, 1.3, 40  # of the law residual; iterations over those of equal moduli, and in all
ORDERS = ("soft block", "soft punch")


def run(study: Study) -> None:
    """A punch on a block: equal moduli, then either of them up to a thousand times softer."""
    study.columns = ("softer", "contrast", "iterations", "law_residual", "stop_reason", "seconds")
    for contrast in CONTRASTS:
        for softer in ORDERS if contrast > 1 else ("neither",):
            moduli = [STIFF / contrast if softer == order else STIFF for order in ORDERS]
            case = Case(with_method(punch(study.folder, *moduli), contact_defaults(law=TOLERANCE)),
                        {"softer": softer, "contrast": contrast})
            solved = solve(config_from(dict(case.config)), study.scene(case.config))
            residual = solved.summary["residuals"]["law_residual"]
            row = {"iterations": solved.iterations, "law_residual": residual, "stop_reason": solved.stop_reason,
                   "seconds": round(solved.summary["timing"]["total"], 2)}
            study.add(case, row, solved.history, f"law residual {residual:.1e}")
    usual = study.rows[0]["iterations"]
    limit = min(int(FACTOR * usual), MOST)
    for row in study.rows[1:]:
        study.target(f"{row['softer']}, 1:{row['contrast']}, law residual ≤ {TOLERANCE:g}",
                     f"at most {limit} iterations, {FACTOR} times those of equal moduli and {MOST}", row["iterations"],
                     row["stop_reason"] == "converged" and row["iterations"] <= limit)
    figure, ((axes,),) = panels()
    for softer, colour, marker in zip(ORDERS, (BLUE, ORANGE), "os"):
        rows = [row for row in study.rows if row["softer"] in (softer, "neither")]
        axes.semilogx([row["contrast"] for row in rows], [row["iterations"] for row in rows], marker + "-", color=colour, label=softer)
    axes.axhline(FACTOR * usual, color=GREY, linewidth=1, linestyle="--")
    axes.set(ylim=(0, None), xlabel="contrast of the moduli", ylabel="iterations")
    axes.set_title(f"Punch on block, μ = 0.2, law residual {TOLERANCE:g}; dashed: {FACTOR} times equal moduli", fontsize=11)
    study.figure(figure)
