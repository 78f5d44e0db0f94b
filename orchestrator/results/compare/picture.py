"""Picture of the difference of two runs: the structure displaced by the difference of displacements, coloured by the stress of that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.artist import CannotDraw, drawn, no_figures
from orchestrator.results.figures.pictures import deformed
from orchestrator.results.figures.plotting import png
from orchestrator.results.figures.sheet import compose
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.solution import Solution

NAME = "difference.png"


def draw_difference(folder: ResultsFolder, one: Path, other: Path) -> str:
    """Draws it; returns why not, where that cannot be: other meshes, no fields, no difference, no graphics."""
    if lacking := no_figures():
        return lacking[0]
    fields = [Solution.read(path).fields for path in (one, other)]
    if None in fields:
        return "no fields"
    shapes = [(f.displacement.shape, f.sides and [u.shape for u in f.sides]) for f in fields]
    if shapes[0] != shapes[1] or not np.array_equal(*(f.cells for f in fields)):
        return "other meshes, parts or load steps"
    between = difference(*fields)
    if not between.displacement.any() and not any(u.any() for u in between.sides or ()):
        return "displacements do not differ"
    try:
        drawn(_draw, folder, between, f"{other} minus {one}")
    except CannotDraw as error:
        return str(error)
    return ""


def difference(one: Fields, other: Fields) -> Fields:
    """The second minus the first, on the same mesh; its stress is that of the displacements' difference, by the first one's moduli."""
    sides = None if one.sides is None else [u - v for u, v in zip(other.sides, one.sides)]
    return replace(one, displacement=other.displacement - one.displacement, sides=sides, interfaces=None, discretisation_error=None,
                   thermal=None)


def _draw(folder: ResultsFolder, between: Fields, title: str) -> None:
    sheet = deformed(between)
    if sheet is not None:
        folder.write(NAME, png(compose(sheet, title)))
