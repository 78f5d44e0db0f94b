"""figures/deformed.png: the deformed surface with von Mises stress, and the undeformed outline.

Where interfaces open, one panel per load step shows the bodies apart (see ``panels``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.stopping.stress import nodal_average
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.painting import PAINTED, scale, show
from orchestrator.results.figures.plotting import new_figure
from orchestrator.results.figures.view import WIDTH, Camera, View, colour_limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LARGEST = 0.1  # largest drawn displacement over the structure's size
_OPENING, _FARTHEST = 0.03, 0.25  # the same for the largest opening, and the limit to which it may raise the other


def most_deformed(fields: Fields) -> int:
    """The load step with the largest displacement."""
    return int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))


def view(fields: Fields) -> View:
    """Prepares the picture of the load step with the largest displacement."""
    return views(fields, [most_deformed(fields)])[0]


def views(fields: Fields, steps: Sequence[int], inches: float = WIDTH) -> list[View]:
    """Pictures of several load steps: one camera, one exaggeration, one colour scale."""
    drawn, whole = fields.opened, fields
    if (drawn.lame[:, 1] == 0).any():  # cells that stand for a part whose mesh is another program's
        ours = np.flatnonzero(drawn.lame[:, 1] > 0)
        drawn, whole = drawn.some(ours), fields.some(ours)
    size = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    largest = {step: float(np.linalg.norm(drawn.displacement[step], axis=1).max()) for step in steps}
    factor = _exaggeration(fields, steps, size, max(largest.values()))

    faces, cell = surface.outer_faces(drawn.nodes, drawn.cells)
    lines = surface.edges(drawn.nodes, faces, drawn.subdomain[cell])
    sharp = surface.edges(whole.nodes, faces if drawn is whole else surface.outer_faces(whole.nodes, whole.cells)[0])
    outline = whole.nodes[sharp] if len(sharp) else surface.box_edges(whole.nodes)
    moved = {step: drawn.nodes + factor * drawn.displacement[step] for step in steps}

    average, node, corner = nodal_average(
        drawn.cells, map(drawn.nodal_von_mises, steps), drawn.volumes, drawn.material)
    local = (drawn.cells[cell][:, None] == faces[:, :, None]).argmax(axis=2)  # which of its tet's nodes a corner is
    used, triangles = np.unique(corner[cell[:, None], local], return_inverse=True)
    values, triangles, node = dict(zip(steps, average[:, used])), triangles.reshape(-1, 3), node[used]
    camera = Camera.framing(np.concatenate([*(moved[step][node] for step in steps), outline.reshape(-1, 3)])).shaped()
    limits, beyond = colour_limits(np.concatenate(list(values.values())))
    return [View(moved[step][node], triangles, values[step], moved[step][lines], outline, camera, limits, beyond,
                 f"displacements drawn × {factor:g}   ·   largest displacement {largest[step]:.3g}   ·   "
                 f"largest von Mises stress {values[step].max():.3g}"
                 + (f"   ·   load step {step + 1} of {fields.steps}" if fields.steps > 1 else ""), inches=inches,
                 magnified=factor)
            for step in steps]


def _exaggeration(fields: Fields, steps: Sequence[int], size: float, largest: float) -> float:
    """Factor that shows the displacements, and the openings where there are any."""
    if largest == 0:
        return 1.0
    factor, i = _LARGEST * size / largest, fields.interfaces
    opening = 0.0 if i is None else float((i.gap - i.initial_gap)[list(steps)].max(initial=0.0))
    if opening > 0:
        factor = max(factor, min(_OPENING * size / opening, _FARTHEST * size / largest))
    return float(f"{factor:.1e}")


def compose(view: View, picture: np.ndarray | None, title: str) -> Figure:
    """The picture with colour scale and caption; matplotlib draws the surface if there is no picture."""
    drawing = WIDTH * view.camera.height / view.camera.width
    below, above = 1.0, 0.4
    total = drawing + below + above
    figure = new_figure(WIDTH, total)
    show(figure.add_axes((0, below / total, 1, drawing / total)), view, picture)
    scale(figure.add_axes((0.25, (below - 0.2) / total, 0.5, 0.13 / total)), view, "von Mises stress")
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    caption = view.caption + ("" if picture is not None else PAINTED)
    figure.text(0.5, 0.08 / total, caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return figure
