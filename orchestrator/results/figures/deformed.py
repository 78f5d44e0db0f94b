"""figures/deformed.png: the deformed surface with von Mises stress, and the undeformed outline.

Where interfaces open, one panel per load step shows the bodies apart (see ``panels``). VTK draws
(see ``drawing``); where VTK cannot, matplotlib does, and the caption says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orchestrator.method.stopping import stress as recovery
from orchestrator.results.figures import surface
from orchestrator.results.fields.fields import Fields

_LARGEST = 0.1  # largest drawn displacement over the structure's size
_OPENING, _FARTHEST = 0.03, 0.25  # the same for the largest opening, and the limit to which it may raise the other
WIDTH, DPI = 9.0, 160  # of the picture, inches and dots per inch
_FLATTEST, _TALLEST = 0.22, 0.75  # height of the drawing over its width
PAINTED = "\n(drawn by matplotlib: VTK cannot draw on this machine)"
# every 16th colour of viridis: readable in grey and by the colour-blind
_COLOURS = ["#440154", "#481b6d", "#46327e", "#3f4788", "#365c8d", "#2e6e8e", "#277f8e", "#21918c", "#1fa187",
            "#2db27d", "#4ac16d", "#73d056", "#a0da39", "#d0e11c", "#fde725"]


@dataclass(frozen=True)
class View:
    """What is drawn: a coloured surface, lines, a camera and a caption.

    Parameters
    ----------
    points : (p, 3) deformed; triangles : (k, 3) int; stress : (p,) von Mises, or what else gives the colour
    lines, outline : (e, 2, 3) deformed edges and subdomain borders, undeformed edges
    limits : of the colour scale; beyond : whether values lie below and above it
    caption : one line
    palette : (c, 3) colours in [0, 1] from the lower limit to the upper
    inches : width of the picture
    shaded : whether light falls on it; without, colours are exactly those of the scale
    magnified : factor on the displacements drawn
    """

    points: np.ndarray
    triangles: np.ndarray
    stress: np.ndarray
    lines: np.ndarray
    outline: np.ndarray
    camera: surface.Camera
    limits: tuple[float, float]
    beyond: tuple[bool, bool]
    caption: str
    palette: np.ndarray = field(default_factory=lambda: viridis())
    inches: float = WIDTH
    shaded: bool = True
    magnified: float = 1.0


def view(fields: Fields, step: int | None = None) -> View:
    """Prepares the picture of one load step; by default the one with the largest displacement."""
    if step is None:
        step = int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))
    return views(fields, [step % fields.steps])[0]


def views(fields: Fields, steps: Sequence[int], inches: float = WIDTH) -> list[View]:
    """Pictures of several load steps: one camera, one exaggeration, one colour scale."""
    drawn = fields.opened
    size = float(np.linalg.norm(np.ptp(fields.nodes, axis=0)))
    largest = {step: float(np.linalg.norm(drawn.displacement[step], axis=1).max()) for step in steps}
    factor = _exaggeration(fields, steps, size, max(largest.values()))

    faces, cell, local = surface.outer_faces(drawn.cells)
    pairs, neighbours = surface.edges(faces)
    owner = fields.subdomain[cell]
    sharp = surface.sharp_edges(drawn.nodes, faces)
    lines = np.concatenate([pairs[owner[neighbours[:, 0]] != owner[neighbours[:, 1]]], sharp])
    if drawn is not fields:  # the outline is the whole structure's
        whole = fields.numbering.nodes[faces]
        sharp = surface.sharp_edges(fields.nodes, whole[surface.alone(whole.T)])
    outline = fields.nodes[sharp] if len(sharp) else surface.box_edges(fields.nodes)

    moved = {step: drawn.nodes + factor * drawn.displacement[step] for step in steps}
    average, node, corner = recovery.nodal_average(
        drawn.cells, map(drawn.nodal_von_mises, steps), drawn.volumes, drawn.material)
    used, triangles = np.unique(corner[cell[:, None], local], return_inverse=True)
    stress = dict(zip(steps, average[:, used]))
    triangles, node = triangles.reshape(-1, 3), node[used]
    camera = shaped(surface.Camera.framing(
        np.concatenate([*(moved[step][node] for step in steps), outline.reshape(-1, 3)])))
    limits, beyond = colour_limits(np.concatenate(list(stress.values())))
    return [View(moved[step][node], triangles, stress[step], moved[step][lines], outline, camera, limits, beyond,
                 f"displacements drawn × {factor:g}   ·   largest displacement {largest[step]:.3g}   ·   "
                 f"largest von Mises stress {stress[step].max():.3g}"
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


def colour_limits(stress: np.ndarray) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Colour limits that a singular corner does not stretch, and whether values lie beyond them."""
    low, high = (float(q) for q in np.percentile(stress, [0.5, 99.5]))
    span = stress.max() - stress.min()
    if high - low > 0.6 * span:
        low, high = float(stress.min()), float(stress.max())
    if high - low <= 1e-6 * abs(high):  # uniform stress: rounding is no pattern
        low, high = (0.0, 2.0 * high) if high > 0 else (0.0, 1.0)
    return (low, high), (bool(stress.min() < low), bool(stress.max() > high))


def shaped(camera: surface.Camera) -> surface.Camera:
    ratio = min(max(camera.height / camera.width, _FLATTEST), _TALLEST)
    return replace(camera, width=max(camera.width, camera.height / ratio),
                   height=max(camera.height, camera.width * ratio))


def viridis() -> np.ndarray:
    colours = np.array([[int(c[i:i + 2], 16) for i in (1, 3, 5)] for c in _COLOURS]) / 255
    at = np.linspace(0, len(colours) - 1, 256)
    return np.stack([np.interp(at, np.arange(len(colours)), colours[:, i]) for i in range(3)], axis=1)


def compose(view: View, picture: np.ndarray | None, title: str) -> bytes:
    """PNG of the picture with colour scale and caption; matplotlib draws the surface if there is no picture."""
    from orchestrator.results.figures.plotting import new_figure, png

    camera = view.camera
    drawing = WIDTH * camera.height / camera.width
    below, above = 1.0, 0.4
    total = drawing + below + above
    figure = new_figure(WIDTH, total)
    show(figure.add_axes((0, below / total, 1, drawing / total)), view, picture)
    caption = view.caption + ("" if picture is not None else PAINTED)
    bar = figure.colorbar(colours(view), cax=figure.add_axes((0.25, (below - 0.2) / total, 0.5, 0.13 / total)),
                          orientation="horizontal",
                          extend=("neither", "max", "min", "both")[2 * view.beyond[0] + view.beyond[1]])
    bar.set_label("von Mises stress", fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8.5)
    bar.outline.set_linewidth(0.5)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return png(figure, DPI)


def colours(view: View) -> object:
    """Matplotlib's mapping from the values of a view to its colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    return ScalarMappable(Normalize(*view.limits), ListedColormap(view.palette))


def show(axes: object, view: View, picture: np.ndarray | None) -> None:
    """Puts a picture into its axes; paints it there if there is none."""
    camera = view.camera
    extent = (-camera.width / 2, camera.width / 2, -camera.height / 2, camera.height / 2)
    axes.set_axis_off()
    if picture is not None:
        axes.imshow(picture, extent=extent, aspect="auto", interpolation="none")
    else:
        _paint(axes, view)
    axes.set(xlim=extent[:2], ylim=extent[2:])


def _paint(axes: object, view: View) -> None:
    """The painter's algorithm: faces turned to the eye, farthest first."""
    from matplotlib.collections import LineCollection, PolyCollection

    facing = surface.normals(view.points, view.triangles) @ view.camera.toward
    front = np.flatnonzero(facing > 0)
    corners = view.camera.project(view.points)[view.triangles[front]]
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    rgb = colours(view).to_rgba(view.stress[view.triangles[front]].mean(axis=1))[:, :3]
    light = (0.65 + 0.38 * facing[front])[:, None] if view.shaded else 1.0
    rgb = np.clip(rgb * light, 0, 1)[order]
    axes.add_collection(LineCollection(view.camera.project(view.outline)[..., :2], colors="0.45", linewidths=0.8))
    axes.add_collection(PolyCollection(corners[order, :, :2], facecolors=rgb, edgecolors=rgb, linewidths=0.2))
