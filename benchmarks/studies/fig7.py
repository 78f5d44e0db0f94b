"""Figure 7: the paper's η over the iterations, and the true error that η hides."""

from __future__ import annotations

from benchmarks.kit.drawing import Curve, draw, grid, label_rows, shades
from benchmarks.kit.study import Case, Study
from benchmarks.problems.alternating import alternating_beam
from benchmarks.problems.cases import CUT, SLICES, beam, defaults, paper, with_method

STRATEGIES = {"none": "mono-scale", "equilibrium": "equilibrium", "continuity": "continuity"}
LONG = 120  # iterations where the figure's are not enough for the table
# Search directions beside the paper's plain one (full k⁺, α = .8), for 32 slices and equilibrium. With a
# diagonal k⁺ the fixed point needs α < 2/(1 + max(λ, 1/λ)), λ = eig(k⁻, k⁺), which depends on how the
# triangles of the interface are laid: 0.29 where all diagonals are parallel.
VARIANTS = (("full", 0.7, "parallel"), ("full", 0.5, "parallel"), ("exchange", 0.5, "parallel"), ("diagonal", 0.5, "parallel"),
            ("diagonal", 0.3, "parallel"), ("diagonal", 0.5, "alternating"))
LABELS = ("strategy", "slices", "settings", "kplus", "alpha", "mesh")


def run(study: Study) -> None:
    """All slices and strategies with the paper's settings and with ours, then other k⁺."""
    study.columns = (*LABELS, "stages_to_eta", "true_error_at_eta", "stages_to_true_error", "iterations", "true_error", "stop_reason")

    def solve(problem, method, *labels):
        study.solve(Case(with_method(problem, method), dict(zip(LABELS, labels))))

    for strategy, name in STRATEGIES.items():
        for slices in SLICES:
            cut = LONG if strategy != "equilibrium" and slices <= 32 else CUT
            solve(beam(slices), paper(strategy, iterations=cut), name, slices, "paper", "full", 0.8, "parallel")
            solve(beam(slices), defaults(strategy, iterations=cut), name, slices, "defaults", "exchange", 1.0, "parallel")
    for kplus, alpha, mesh in VARIANTS:
        problem = beam(32) | ({"mesh": {"file": str(alternating_beam(study.folder))}} if mesh == "alternating" else {})
        solve(problem, paper("equilibrium", kplus=kplus, relaxation=alpha), "equilibrium", 32, "paper", kplus, alpha, mesh)
    _targets(study)
    study.figure(_picture(study))


def _targets(study: Study) -> None:
    def stages(strategy, slices, kplus="full", alpha=0.8, mesh="parallel"):
        asked = (strategy, slices, "paper", kplus, alpha, mesh)
        return next(row["stages_to_eta"] for row in study.rows if asked == tuple(row[k] for k in LABELS))

    mono = stages("mono-scale", 8)
    study.target("8 slices, mono-scale, paper's sole, α = .8: η < 1e-5", "within 40–60 (paper: 50)", mono,
                 mono is not None and 40 <= mono <= 60)
    for mesh in ("parallel", "alternating"):
        found = stages("equilibrium", 32, "diagonal", 0.5, mesh)
        study.target(f"32 slices, equilibrium, diagonal k⁺, α = .5, {mesh} diagonals in the mesh: η < 1e-5",
                     "within 12 (paper: 7)", found, found is not None and found <= 12)
    few, many = stages("continuity", 8), stages("continuity", 32)
    study.target("continuity, 8 → 32 slices: η < 1e-5", "clearly more stages", f"{few} → {many}",
                 few is not None and (many is None or many >= 1.5 * few))


def _picture(study: Study):
    figure, axes = grid(2, 3, 12.0)
    colours = dict(zip(SLICES, shades(len(SLICES))))
    for column, name in enumerate(STRATEGIES.values()):
        curves = [Curve(history, colours[row["slices"]], f"{row['slices']} slices" if row["settings"] == "paper" else "",
                        "-" if row["settings"] == "paper" else "--")
                  for row, history in zip(study.rows[:6 * len(SLICES)], study.histories) if row["strategy"] == name]
        draw(axes[0, column], curves, "indicator", limits=(1e-9, 1), last=CUT, mark=(1e-5, "" if column else "η = 1e-5"))
        draw(axes[1, column], curves, "true_error", limits=(1e-7, 1), last=CUT, mark=(1e-6, "" if column else "1e-6"))
        axes[0, column].set_title(f"({'abc'[column]}) {name}", fontsize=11)
    label_rows(axes, ("indicator η (a squared ratio)", "true relative energy error"))
    figure.suptitle("Beam in tension: the paper's settings (solid) and the defaults (dashed)", fontsize=12)
    return figure
