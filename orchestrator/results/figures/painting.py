"""Puts views into matplotlib's axes, with their colour scales; matplotlib paints what no canvas has drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.view import Camera, View

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform

UNKNOWN = 0.75  # grey of what has no value
PAINTED = "\n(drawn by matplotlib: VTK cannot draw on this machine)"


def colours(view: View) -> ScalarMappable:
    """From the values of a view to its colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(*view.limits), view.palette)


def show(axes: Axes, view: View, picture: np.ndarray | None) -> None:
    """Puts a picture into its axes; paints it there if there is none."""
    camera = view.camera
    extent = (-camera.width / 2, camera.width / 2, -camera.height / 2, camera.height / 2)
    axes.set_axis_off()
    if picture is not None:
        axes.figure.add_artist(dot_for_dot(picture, axes.bbox.x0, axes.bbox.y0))
    else:
        _paint(axes, view)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    if view.mark is not None:
        _point_at(axes, axes.transData, *view.mark, camera)


def place(figure: Figure, at: tuple[float, float, float, float], view: View, picture: np.ndarray) -> None:
    """The same of a picture without axes, which take as long to make as all that is drawn in them.

    Parameters
    ----------
    at : left, bottom, width and height, shares of the figure
    """
    from matplotlib.transforms import Bbox, BboxTransform, TransformedBbox

    camera, box = view.camera, TransformedBbox(Bbox.from_bounds(*at), figure.transFigure)
    figure.add_artist(dot_for_dot(picture, box.x0, box.y0))
    if view.mark is not None:
        extent = Bbox.from_bounds(-camera.width / 2, -camera.height / 2, camera.width, camera.height)
        _point_at(figure, BboxTransform(extent, box), *view.mark, camera)


def dot_for_dot(picture: np.ndarray, left: float, bottom: float) -> Artist:
    """A picture (rows, columns, 3) uint8 with its lower left corner at a dot, behind all axes.

    Matplotlib's own images are fitted into their place, even where they fit: that takes longer than to draw all else.
    """
    from matplotlib.artist import Artist

    opaque = np.full((*picture.shape[:2], 4), 255, np.uint8)
    opaque[..., :3] = picture[::-1]  # Agg begins at the bottom

    class Picture(Artist):
        def draw(self, renderer):
            context = renderer.new_gc()
            renderer.draw_image(context, round(left), round(bottom), opaque)
            context.restore()

    drawn = Picture()
    drawn.set_zorder(-1)
    return drawn


def _point_at(holder: Axes | Figure, transform: Transform, place: np.ndarray, value: float, visible: bool, camera: Camera) -> None:
    """A ring around the place of the peak, paler where it is hidden, and its value beside it, towards the picture's middle."""
    from matplotlib.lines import Line2D
    from matplotlib.text import Annotation

    text = f"peak {value:.3g}" + ("" if visible else " (behind or inside)")
    x, y = camera.project(place)[:2]
    holder.add_artist(Line2D(
        [x], [y], transform=transform, marker="o", markersize=9, markerfacecolor="none", markeredgecolor="#D55E00",
        markeredgewidth=1.6, linestyle="none", fillstyle="none" if visible else "top", alpha=1.0 if visible else 0.6))
    holder.add_artist(Annotation(
        text, (x, y), xycoords=transform, xytext=(-12 if x > 0 else 12, -14 if y > 0 else 14),
        textcoords="offset points", ha="right" if x > 0 else "left", va="top" if y > 0 else "bottom", fontsize=8.5,
        color="#8a3c00", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}))


def scale(axes: Axes, view: View, label: str, names: Sequence[str] = ()) -> None:
    """Fills axes with the colour scale of a view; ``names`` for 0, 1, 2 … where its colours are kinds."""
    bar = axes.figure.colorbar(colours(view), cax=axes, orientation="horizontal",
                               extend=("neither", "max", "min", "both")[2 * view.beyond[0] + view.beyond[1]])
    bar.set_label(label, fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8.5)
    bar.outline.set_linewidth(0.5)
    if names:
        bar.set_ticks(range(len(names)), labels=names)
        bar.ax.tick_params(length=0)


def _paint(axes: Axes, view: View) -> None:
    """The painter's algorithm: farthest faces first, of a body those turned to the eye."""
    from matplotlib.collections import LineCollection, PolyCollection

    corners = view.camera.project(view.points)[view.triangles]
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(one, other)
    facing = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    front = np.flatnonzero(facing > 0) if view.shaded else np.arange(len(corners))
    order = front[np.argsort(corners[front, :, 2].mean(axis=1))]
    values = view.values[view.triangles[order]].mean(axis=1)
    rgb = np.where(np.isfinite(values)[:, None], colours(view).to_rgba(values)[:, :3], UNKNOWN)
    if view.shaded:
        rgb = np.clip(rgb * (0.65 + 0.38 * facing[order])[:, None], 0, 1)
    axes.add_collection(LineCollection(view.camera.project(view.outline)[..., :2], colors="0.45", linewidths=0.8))
    axes.add_collection(PolyCollection(corners[order, :, :2], facecolors=rgb, edgecolors=rgb, linewidths=0.2))
