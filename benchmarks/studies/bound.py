"""The error bound beside the true error, from crude to rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orchestrator.results.figures.plotting import BLUE, GREEN, GREY, ORANGE, new_figure, png, tidy
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bracket import bracket
from benchmarks.problems.cases import beam, cube, defaults, with_method

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
EFFECTIVITY = 5.0


def run(study: Study) -> None:
    """Three kinds of subdomains, five tolerances."""
    study.columns = ("case", "tolerance", "iterations", "true_error", "error_bound", "effectivity", "stop_reason",
                     "seconds")
    problems = {"32 slices": beam(32), "4³ cubes": cube(4), "64 METIS parts": bracket(Path(study.folder.path), h=4.0)}
    for name, problem in problems.items():
        for tolerance in TOLERANCES:
            study.solve(Case(with_method(problem, defaults(error=tolerance)), {"case": name, "tolerance": tolerance}))
            row = study.rows[-1]
            sound = 1.0 <= row["effectivity"] <= EFFECTIVITY
            reached = row["stop_reason"] == "converged"
            floor = "" if reached else f"; floor: {row['stop_reason']}"
            study.target(f"{name}, tolerance {tolerance:g}", f"true error ≤ bound ≤ {EFFECTIVITY:g} × true error",
                         f"{row['true_error']:.2e} ≤ {row['error_bound']:.2e}: × {row['effectivity']:.2f}{floor}",
                         sound if reached else row["error_bound"] >= row["true_error"])
    study.figure(_picture(study, list(problems)))


def _picture(study: Study, names: list[str]) -> bytes:
    figure = new_figure(6.4, 5.2)
    axes = figure.subplots()
    line = np.array([1e-12, 1.0])
    axes.loglog(line, line, color=GREY, linewidth=1)
    axes.loglog(line, EFFECTIVITY * line, color=GREY, linewidth=1, linestyle="--")
    for name, colour, marker in zip(names, (BLUE, ORANGE, GREEN), "os^"):
        rows = [row for row in study.rows if row["case"] == name]
        axes.loglog([r["true_error"] for r in rows], [r["error_bound"] for r in rows], marker, color=colour,
                    label=name, markersize=7, markerfacecolor="none", markeredgewidth=1.5)
    axes.annotate("bound = true error", (3e-6, 3e-6), xytext=(6, -12), textcoords="offset points", fontsize=8.5,
                  color=GREY)
    axes.annotate(f"bound = {EFFECTIVITY:g} × true error", (3e-6, 3e-6 * EFFECTIVITY), xytext=(-6, 6),
                  textcoords="offset points", fontsize=8.5, color=GREY, ha="right")
    axes.set(xlim=(1e-11, 1e-1), ylim=(1e-11, 1e-1), xlabel="true relative energy error",
             ylabel="guaranteed bound at the stop")
    axes.set_title("The bound at tolerances 1e-2 to 1e-10", fontsize=11)
    tidy(axes)
    axes.legend(fontsize=9, frameon=False, loc="upper left")
    figure.tight_layout()
    return png(figure)
