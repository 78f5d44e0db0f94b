"""How the number of linear stages grows with the number of subdomains."""

from __future__ import annotations

from collections.abc import Sequence

from orchestrator.results.figures.plotting import png
from benchmarks.kit.drawing import Curve, draw, grid, label_rows, shades
from benchmarks.kit.study import Case, Study
from benchmarks.problems.cases import beam, cube, defaults, with_method

COLUMNS = ("case", "subdomains", "dofs", "stages_to_true_error", "iterations", "true_error", "error_bound",
           "effectivity", "stop_reason", "seconds")
SLICES = {8: 5, 32: 12, 64: 16, 128: 26}  # slices: stages wanted
CUBES, CUBE_STAGES, SPREAD = (3, 4, 5), 20, 3


def slices(study: Study) -> None:
    """The beam in tension."""
    study.columns = COLUMNS
    for count, wanted in SLICES.items():
        study.solve(Case(with_method(beam(count), defaults()), {"case": f"{count} slices"}))
        found = study.rows[-1]["stages_to_true_error"]
        study.target(f"{count} slices, tension: true error ≤ 1e-6", f"at most {wanted} stages", found,
                     found is not None and found <= wanted)
    study.figure(picture(study, "Slices of a beam in tension, defaults"))


def cubes(study: Study) -> None:
    """Cubes of 4 elements a side in bending and tension."""
    study.columns = COLUMNS
    for count in CUBES:
        study.solve(Case(with_method(cube(count), defaults()), {"case": f"{count}³ cubes"}))
    found = [row["stages_to_true_error"] for row in study.rows]
    for count, stages in zip(CUBES, found):
        study.target(f"{count}³ cubes, bending and tension: true error ≤ 1e-6", f"at most {CUBE_STAGES} stages", stages,
                     stages is not None and stages <= CUBE_STAGES)
    even = None not in found and max(found) - min(found) <= SPREAD
    study.target("the same number for all three", f"± {SPREAD}", " / ".join(map(str, found)), even)
    study.figure(picture(study, "Cubes with 4 elements a side in bending and tension, defaults"))


def picture(study: Study, title: str, names: Sequence[str] = ()) -> bytes:
    """True error (solid) and bound (dashed) of all cases over the iterations."""
    figure, axes = grid(1, 1, 7.2, 4.0)
    last = max(len(history) for history in study.histories) + 1
    for row, history, colour in zip(study.rows, study.histories, shades(len(study.rows))):
        draw(axes[0, 0], [Curve(history, colour, f"{row['case']}: true error")], "true_error",
             limits=(1e-7, 1), last=last)
        draw(axes[0, 0], [Curve(history, colour, f"{row['case']}: bound", "--")], "error_bound",
             limits=(1e-7, 1), last=last)
    draw(axes[0, 0], [], "true_error", limits=(1e-7, 1), last=last, mark=(1e-6, "tolerance 1e-6"))
    label_rows(axes, ("relative energy error",))
    axes[0, 0].legend(fontsize=8.5, frameon=False)
    axes[0, 0].set_title(title, fontsize=11)
    figure.tight_layout()
    return png(figure)
