"""The error bound beside the true error, from crude to rounding."""

from __future__ import annotations

from benchmarks.kit.drawing import PALETTE, between_lines, panels
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bracket import bracket
from benchmarks.problems.cases import beam, cube, defaults, with_method

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
EFFECTIVITY = 5.0


def run(study: Study) -> None:
    """Three kinds of subdomains, five tolerances."""
    study.columns = ("case", "tolerance", "iterations", "true_error", "error_bound", "effectivity", "stop_reason", "seconds")
    problems = {"32 slices": beam(32), "4³ cubes": cube(4), "64 METIS parts": bracket(study.folder, h=4.0)}
    for name, problem in problems.items():
        for tolerance in TOLERANCES:
            study.solve(Case(with_method(problem, defaults(error=tolerance)), {"case": name, "tolerance": tolerance}))
            row = study.rows[-1]
            reached = row["stop_reason"] == "converged"
            study.target(f"{name}, tolerance {tolerance:g}", f"true error ≤ bound ≤ {EFFECTIVITY:g} × true error",
                         f"{row['true_error']:.2e} ≤ {row['error_bound']:.2e}: × {row['effectivity']:.2f}"
                         + ("" if reached else f"; floor: {row['stop_reason']}"),
                         1.0 <= row["effectivity"] <= EFFECTIVITY if reached else row["error_bound"] >= row["true_error"])
    figure, ((axes,),) = panels(size=(6.4, 5.2))
    between_lines(axes, EFFECTIVITY, (1e-11, 1e-1))
    for name, colour, marker in zip(problems, PALETTE, "os^"):
        rows = [row for row in study.rows if row["case"] == name]
        axes.loglog([r["true_error"] for r in rows], [r["error_bound"] for r in rows], marker, color=colour, label=name,
                    markersize=7, markerfacecolor="none", markeredgewidth=1.5)
    axes.set_title(f"Tolerances 1e-2 to 1e-10; solid: bound = true error, dashed: {EFFECTIVITY:g} times", fontsize=10)
    study.figure(figure)
