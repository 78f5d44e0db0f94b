"""figures/deformed.png: the deformed surface with von Mises stress, and the undeformed outline.

Where interfaces open, one panel per load step shows the bodies apart (see ``panels``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.look import Look
from orchestrator.results.figures.painting import PAINTED, scale, show
from orchestrator.results.figures.plotting import new_figure
from orchestrator.results.figures.skin import Shape, skin
from orchestrator.results.figures.skin import shape as shape_of
from orchestrator.results.figures.view import WIDTH, Camera, View, colour_limits, toward_eye
from orchestrator.scene.mesh.geometry import area_vectors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LARGEST = 0.1  # largest drawn displacement over the structure's size
_OPENING, _FARTHEST = 0.03, 0.25  # the same for the largest opening, and the limit to which it may raise the other


def most_deformed(fields: Fields) -> int:
    """The load step with the largest displacement."""
    return int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))


def view(fields: Fields, look: Look = Look(), shape: Shape | None = None, stress: Mapping[int, np.ndarray] | None = None) -> View:
    """Prepares the picture of the load step with the largest displacement."""
    return views(fields, [most_deformed(fields)], WIDTH, look, shape, stress)[0]


def views(fields: Fields, steps: Sequence[int], inches: float = WIDTH, look: Look = Look(), shape: Shape | None = None,
          stress: Mapping[int, np.ndarray] | None = None) -> list[View]:
    """Pictures of several load steps: one camera, one exaggeration, one colour scale; shape and stress as for ``skin``."""
    drawn, units = fields.opened, look.units
    size = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    ours = np.zeros(len(drawn.nodes), dtype=bool)
    ours[drawn.cells[drawn.lame[:, 1] > 0]] = True  # others stand for parts whose mesh is another program's
    largest = {step: float(np.linalg.norm(drawn.displacement[step][ours], axis=1).max(initial=0.0)) for step in steps}
    factor = exaggeration(fields, steps, size, max(largest.values()))

    toward = toward_eye(fields.nodes) if look.direction is None else look.direction
    if look.cut is None:
        shape = shape or shape_of(fields, look)
    outline = np.empty((0, 2, 3)) if look.cut is not None else shape.outline
    seen = skin(fields, steps, look, toward, shape, stress)
    moved = {step: seen.points + factor * seen.displacement[step] for step in steps}
    camera = Camera.framing(np.concatenate([*moved.values(), outline.reshape(-1, 3)]),
                            direction=toward if look.cut is not None or look.direction is not None else None).shaped()
    areas = np.linalg.norm(area_vectors(seen.points, seen.triangles), axis=1)
    weight = np.bincount(seen.triangles.ravel(), np.repeat(areas / 3, 3), minlength=len(seen.points))
    limits, beyond = colour_limits(np.concatenate(list(seen.stress.values())), np.tile(weight, len(steps)))
    made = []
    for step in steps:
        peak = seen.peaks[step]
        told = [f"displacements drawn × {factor:g}", f"largest displacement {largest[step]:.3g}{units['length']}",
                "stress not known (grey)" if peak is None else f"largest von Mises stress {peak[1]:.3g}{units['stress']}",
                *([f"load step {step + 1} of {fields.steps}"] if fields.steps > 1 else []),
                *([f"cut at {'xyz'[look.cut[0]]} = {look.cut[1]:g}"] if look.cut is not None else [])]
        made.append(View(moved[step], seen.triangles, seen.stress[step], moved[step][seen.lines], outline, camera, limits,
                         beyond, "   ·   ".join(told), inches=inches, closed=look.cut is None, magnified=factor,
                         mark=_mark(peak, factor, moved[step], seen.triangles, camera)))
    return made


def _mark(peak: tuple[np.ndarray, float] | None, factor: float, points: np.ndarray, triangles: np.ndarray,
          camera: Camera) -> tuple[np.ndarray, float, bool] | None:
    """Where the largest stress is, for the picture; faces turned to the eye are taken for visible."""
    if peak is None or not peak[1] > 0:
        return None
    (place, moved), value = peak
    at = place + factor * moved
    near = np.linalg.norm(points - at, axis=1) <= 1e-9 * max(camera.width, camera.height)
    around = triangles[near[triangles].any(axis=1)]
    facing = bool(len(around)) and bool((area_vectors(points, around) @ camera.toward > 0).any())
    return at, value, facing


def exaggeration(fields: Fields, steps: Sequence[int], size: float, largest: float) -> float:
    """Factor that shows the displacements, and the openings where there are any."""
    if largest == 0:
        return 1.0
    factor, i = _LARGEST * size / largest, fields.interfaces
    opening = 0.0 if i is None else float((i.gap - i.initial_gap)[list(steps)].max(initial=0.0))
    if opening > 0:
        factor = max(factor, min(_OPENING * size / opening, _FARTHEST * size / largest))
    return float(f"{factor:.1e}")


def compose(view: View, picture: np.ndarray | None, title: str, look: Look = Look()) -> Figure:
    """The picture with colour scale and caption; matplotlib draws the surface if there is no picture."""
    drawing = WIDTH * view.camera.height / view.camera.width
    below, above = 1.0, 0.4
    total = drawing + below + above
    figure = new_figure(WIDTH, total)
    show(figure.add_axes((0, below / total, 1, drawing / total)), view, picture)
    scale(figure.add_axes((0.25, (below - 0.2) / total, 0.5, 0.13 / total)), view, f"von Mises stress{look.units['stress'] and ',' + look.units['stress']}")
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    caption = view.caption + ("" if picture is not None else PAINTED)
    figure.text(0.5, 0.08 / total, caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return figure
