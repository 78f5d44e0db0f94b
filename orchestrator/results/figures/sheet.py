"""A figure of pictures: a title, a grid of views with headings, colour scales, and a caption. Matplotlib sets the text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.plotting import DPI, new_figure
from orchestrator.results.figures.view import WIDTH, View

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform

_HEADING, _BELOW, _ABOVE = 0.26, 0.95, 0.42  # inches over each picture that has a heading, below and above all
_MARK, _MARK_TEXT = "#D55E00", "#8a3c00"


@dataclass(frozen=True)
class Scale:
    """A colour scale: the colours of a view; ``names`` of 0, 1, 2 … where they are kinds."""

    view: View
    label: str
    names: Sequence[str] = ()


@dataclass(frozen=True)
class Sheet:
    """A grid of views, row by row.

    views : all of the same proportions; headings : one each, of which all may be empty
    columns : of the grid
    scales : beside each other below the grid
    caption : one line below all
    """

    views: Sequence[View]
    headings: Sequence[str]
    columns: int
    scales: Sequence[Scale]
    caption: str


def compose(sheet: Sheet, title: str) -> Figure:
    """The figure; its pictures are drawn now, dot for dot."""
    from orchestrator.results.figures.canvas import draw  # in a process apart from the run

    camera, rows = sheet.views[0].camera, -(-len(sheet.views) // sheet.columns)
    width, heading = WIDTH / sheet.columns, _HEADING * any(sheet.headings)
    height = width * camera.height / camera.width
    total = _ABOVE + rows * (height + heading) + _BELOW
    figure = new_figure(WIDTH, total)
    for k, (view, text) in enumerate(zip(sheet.views, sheet.headings)):
        row, column = divmod(k, sheet.columns)
        left, bottom = column * width, total - _ABOVE - (row + 1) * (height + heading)
        figure.add_artist(_dot_for_dot(draw(view, width), round(left * DPI), round(bottom * DPI)))
        if view.mark is not None:
            _point_at(figure, view, left, bottom, width)
        figure.text((left + 0.5 * width) / WIDTH, (bottom + height + 0.04) / total, text, ha="center", va="bottom", fontsize=9)
    for k, scale in enumerate(sheet.scales):
        wide = 0.8 / len(sheet.scales) if scale.names or len(sheet.scales) > 1 else 0.5
        _scale(figure.add_axes(((k + 0.5) / len(sheet.scales) - 0.5 * wide, (_BELOW - 0.2) / total, wide, 0.13 / total)), scale)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, sheet.caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return figure


def _dot_for_dot(picture: np.ndarray, left: int, bottom: int) -> Artist:
    """A picture with its lower left corner at a dot, behind all else: ``figimage`` would resample it, which takes .1 s."""
    from matplotlib.artist import Artist

    opaque = np.full((*picture.shape[:2], 4), 255, np.uint8)
    opaque[..., :3] = picture[::-1]  # Agg begins at the bottom

    class Picture(Artist):
        zorder = -1

        def draw(self, renderer):
            renderer.draw_image(renderer.new_gc(), left, bottom, opaque)

    return Picture()


def _point_at(figure: Figure, view: View, left: float, bottom: float, width: float) -> None:
    """A ring around the place of the peak, paler where it is hidden, and its value beside it, towards the picture's middle."""
    from matplotlib.lines import Line2D
    from matplotlib.text import Annotation

    (place, value, visible), camera = view.mark, view.camera
    x, y = camera.project(place)[:2]
    at: tuple[float, float] = left + (x / camera.width + 0.5) * width, bottom + (y + 0.5 * camera.height) / camera.width * width
    inches: Transform = figure.dpi_scale_trans
    figure.add_artist(Line2D([at[0]], [at[1]], transform=inches, marker="o", markersize=9, markerfacecolor="none", markeredgecolor=_MARK,
                             markeredgewidth=1.6, linestyle="none", alpha=1.0 if visible else 0.6))
    figure.add_artist(Annotation(
        f"peak {value:.3g}" + ("" if visible else " (behind or inside)"), at, xycoords=inches,
        xytext=(-12 if x > 0 else 12, -14 if y > 0 else 14), textcoords="offset points",
        ha="right" if x > 0 else "left", va="top" if y > 0 else "bottom", fontsize=8.5,
        color=_MARK_TEXT, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}))


def _scale(axes: Axes, scale: Scale) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    view = scale.view
    bar = axes.figure.colorbar(ScalarMappable(Normalize(*view.limits), view.palette), cax=axes, orientation="horizontal",
                               extend=("neither", "max", "min", "both")[2 * view.beyond[0] + view.beyond[1]])
    bar.set_label(scale.label, fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8.5)
    bar.outline.set_linewidth(0.5)
    if scale.names:
        bar.set_ticks(range(len(scale.names)), labels=scale.names)
        bar.ax.tick_params(length=0)
