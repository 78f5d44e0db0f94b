"""Puts views into matplotlib's axes, with their colour scales; matplotlib paints what no canvas has drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

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
        axes.imshow(picture, extent=extent, aspect="auto", interpolation="none")
    else:
        _paint(axes, view)
    axes.set(xlim=extent[:2], ylim=extent[2:])


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
    rgb = colours(view).to_rgba(view.values[view.triangles[order]].mean(axis=1))[:, :3]
    if view.shaded:
        rgb = np.clip(rgb * (0.65 + 0.38 * facing[order])[:, None], 0, 1)
    axes.add_collection(LineCollection(view.camera.project(view.outline)[..., :2], colors="0.45", linewidths=0.8))
    axes.add_collection(PolyCollection(corners[order, :, :2], facecolors=rgb, edgecolors=rgb, linewidths=0.2))
