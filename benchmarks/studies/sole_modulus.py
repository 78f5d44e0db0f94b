"""Figures 10 and 11: what the soles' modulus does to displacement jumps, force imbalances and the true error."""

from __future__ import annotations

from benchmarks.kit.drawing import Curve, draw, grid, label_rows, shades
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import CUT, beam, defaults, paper, with_method

FACTORS = (0.01, 0.1, 1.0, 10.0, 100.0)
PAPER_RATIO, OUR_RATIO = 0.008, 0.5
QUANTITIES = {"displacement_jump": "displacement jump ‖B w‖", "force_imbalance": "force imbalance ‖A f‖",
              "true_error": "true relative energy error"}


def equilibrium(study: Study) -> None:
    """Figure 10."""
    _run(study, "equilibrium")


def continuity(study: Study) -> None:
    """Figure 11."""
    _run(study, "continuity")


def _run(study: Study, strategy: str) -> None:
    study.columns = ("settings", "factor", "modulus_ratio", "iterations", "displacement_jump", "force_imbalance",
                     "stages_to_eta", "true_error_at_eta", "stages_to_true_error", "true_error", "stop_reason")
    for settings in ("paper", "defaults"):
        for factor in FACTORS:
            ratio = factor * (PAPER_RATIO if settings == "paper" else OUR_RATIO)
            method = paper(strategy, modulus_ratio=ratio) if settings == "paper" else \
                defaults(strategy, modulus_ratio=ratio, error=None, iterations=CUT)
            study.solve(Case(with_method(beam(32), method), {"settings": settings, "factor": factor, "modulus_ratio": ratio}),
                        lambda solved: {name: float(solved.history[name][-1]) for name in list(QUANTITIES)[:2]})
    rows = {row["factor"]: row for row in study.rows if row["settings"] == "paper"}  # the paper's limits, eq. 45 and eq. 46
    for quantity, worse, name in (("displacement_jump", 0.01, "soft soles: the displacement jump is left behind"),
                                  ("force_imbalance", 100.0, "stiff soles: the force imbalance is left behind")):
        one, other = rows[1.0][quantity], rows[worse][quantity]
        study.target(f"paper's settings, {name}", "more than at factor 1", f"{other:.1e} against {one:.1e}", other > one)
    study.figure(_picture(study, strategy))


def _picture(study: Study, strategy: str):
    figure, axes = grid(2, 3, 12.0)
    colours = dict(zip(FACTORS, shades(len(FACTORS), "plasma")))
    for row, (settings, ratio) in enumerate((("paper", PAPER_RATIO), ("defaults", OUR_RATIO))):
        curves = [Curve(history, colours[r["factor"]], f"× {r['factor']:g}")
                  for r, history in zip(study.rows, study.histories) if r["settings"] == settings]
        for column, (quantity, name) in enumerate(QUANTITIES.items()):
            draw(axes[row, column], curves, quantity, limits=(1e-8, 10), last=CUT)
            axes[0, column].set_title(name, fontsize=11)
        axes[row, 0].legend(title=f"$E_S$ / {ratio:g} E", fontsize=8.5, frameon=False, ncols=2, loc="upper right")
    label_rows(axes, ("the paper's settings", "the defaults"))
    figure.suptitle(f"32 slices, {strategy}: soles softer and stiffer", fontsize=12)
    return figure
