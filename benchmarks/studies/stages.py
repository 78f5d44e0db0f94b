"""How many linear stages runs need: slices, cubes, METIS parts, a CAD assembly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.kit.drawing import Curve, draw, grid, label_rows, shades
from benchmarks.kit.study import Case, Study
from benchmarks.problems.bracket import bracket
from benchmarks.problems.cases import assembly as assembly_problem
from benchmarks.problems.cases import beam, cube, defaults, with_method

COLUMNS = ("case", "subdomains", "dofs", "stages_to_true_error", "iterations", "true_error", "error_bound",
           "effectivity", "stop_reason", "seconds")
SLICES = {8: 5, 32: 12, 64: 16, 128: 26}  # slices: stages wanted
CUBES, CUBE_STAGES, SPREAD = (3, 4, 5), 20, 3
METIS_STAGES = 25


def slices(study: Study) -> None:
    """The beam in tension."""
    for count, wanted in SLICES.items():
        _solve(study, f"{count} slices", beam(count), wanted)
    study.figure(picture(study, "Slices of a beam in tension, defaults"))


def cubes(study: Study) -> None:
    """Cubes of 4 elements a side in bending and tension."""
    found = [_solve(study, f"{count}³ cubes", cube(count), CUBE_STAGES) for count in CUBES]
    study.target("the same number for all three", f"± {SPREAD}", " / ".join(map(str, found)),
                 None not in found and max(found) - min(found) <= SPREAD)
    study.figure(picture(study, "Cubes with 4 elements a side in bending and tension, defaults"))


def metis(study: Study) -> None:
    """64 parts of a bracket with a hole."""
    _solve(study, "64 METIS parts", bracket(study.folder), METIS_STAGES)
    study.figure(picture(study, "A bracket in 64 METIS parts, defaults"))


def assembly(study: Study) -> None:
    """18 bonded solids; the plate is clamped at its base and the rod pulled."""
    _solve(study, "18 solids, bonded", assembly_problem(), METIS_STAGES)
    study.figure(picture(study, "The assembly as1-tu-203 in its 18 solids, defaults"))


def _solve(study: Study, name: str, problem: Mapping[str, Any], wanted: int) -> int | None:
    study.columns = COLUMNS
    study.solve(Case(with_method(problem, defaults()), {"case": name}))
    found = study.rows[-1]["stages_to_true_error"]
    study.target(f"{name}: true error ≤ 1e-6", f"at most {wanted} stages", found, found is not None and found <= wanted)
    return found


def picture(study: Study, title: str):
    """True error (solid) and bound (dashed) of all cases over the iterations."""
    figure, axes = grid(1, 1, 7.2, 4.0)
    last = max(len(history["iteration"]) for history in study.histories) + 1
    for row, history, colour in zip(study.rows, study.histories, shades(len(study.rows))):
        for quantity, name, style in (("true_error", "true error", "-"), ("error_bound", "bound", "--")):
            draw(axes[0, 0], [Curve(history, colour, f"{row['case']}: {name}", style)], quantity, limits=(1e-7, 1), last=last,
                 mark=(1e-6, "tolerance 1e-6"))
    label_rows(axes, ("relative energy error",))
    axes[0, 0].set_title(title, fontsize=11)
    return figure
