"""A figure of pictures: a grid of views, drawn off screen by pyvista, with headings, colour scales and a caption by matplotlib.

Where neither a display, EGL nor OSMesa is to be had, VTK ends its process with a segmentation fault instead of an error: only a
process apart from the run may draw here (see ``artist``).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.plotting import DPI, new_figure
from orchestrator.results.figures.view import WIDTH, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform
    from pyvista import Plotter

_HEADING, _BELOW, _ABOVE = 0.26, 0.95, 0.42  # inches over each picture that has a heading, below and above all
UNKNOWN = (0.75, 0.75, 0.75)  # of what has no value
# colour, width in pixels of a picture of 1000, opacity
_LINES = {"lines": ("black", 1.1, 0.45), "outline": ("#595959", 1.3, 1.0)}
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


@cache
def _window() -> Plotter:
    """A window that is never shown, for all pictures of this process: to open it takes longer than to draw."""
    import pyvista

    if not os.environ.get("DISPLAY"):  # otherwise VTK tries X first and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    plotter = pyvista.Plotter(off_screen=True, lighting="none", window_size=(16, 16), theme=pyvista.themes.DocumentTheme())
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.enable_parallel_projection()
    plotter.show(auto_close=False)
    return plotter


def draw(view: View, inches: float = WIDTH) -> np.ndarray:
    """(rows, columns, 3) uint8, the picture of a view in a width."""
    import pyvista

    plotter, camera, pixels = _window(), view.camera, view.pixels(inches)
    plotter.clear_actors()
    plotter.render_window.SetSize(*pixels)
    plotter.add_mesh(
        pyvista.PolyData.from_regular_faces(view.points, view.triangles), scalars=np.asarray(view.values, float), cmap=view.palette,
        clim=view.limits, nan_color=UNKNOWN, interpolate_before_map=True, show_scalar_bar=False, lighting=view.shaded,
        ambient=0.65 if view.shaded else 1.0, diffuse=0.38 * view.shaded, culling="back" if view.closed else None,
        reset_camera=False, render=False)
    for name, (colour, width, opacity) in _LINES.items():
        if len(ends := getattr(view, name)):
            actor = plotter.add_mesh(pyvista.line_segments_from_points(ends.reshape(-1, 3)), color=colour, opacity=opacity, lighting=False,
                                     line_width=max(1.0, pixels[0] / 1000) * width, reset_camera=False, render=False)
            actor.mapper.resolve = "polygon_offset"  # a hair nearer than the faces they lie on
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
    plotter.camera.position = camera.focus + camera.height * camera.toward
    plotter.camera.focal_point = camera.focus
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = 0.5 * camera.height
    plotter.reset_camera_clipping_range()
    plotter.render()
    return plotter.screenshot(return_img=True)


def compose(sheet: Sheet, title: str) -> Figure:
    """The figure; its pictures are drawn now, dot for dot."""
    camera, rows = sheet.views[0].camera, -(-len(sheet.views) // sheet.columns)
    width, heading = WIDTH / sheet.columns, _HEADING * any(sheet.headings)
    height = width * camera.height / camera.width
    total = _ABOVE + rows * (height + heading) + _BELOW
    figure = new_figure(WIDTH, total)
    for k, (view, text) in enumerate(zip(sheet.views, sheet.headings)):
        row, column = divmod(k, sheet.columns)
        left, bottom = column * width, total - _ABOVE - (row + 1) * (height + heading)
        figure.figimage(draw(view, width), round(left * DPI), round(bottom * DPI), origin="upper", zorder=-1)
        if view.mark is not None:
            _point_at(figure, view, left, bottom, width)
        figure.text((left + 0.5 * width) / WIDTH, (bottom + height + 0.04) / total, text, ha="center", va="bottom", fontsize=9)
    for k, scale in enumerate(sheet.scales):
        wide = 0.8 / len(sheet.scales) if scale.names or len(sheet.scales) > 1 else 0.5
        _scale(figure.add_axes(((k + 0.5) / len(sheet.scales) - 0.5 * wide, (_BELOW - 0.2) / total, wide, 0.13 / total)), scale)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, sheet.caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return figure


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
    figure.add_artist(Annotation(f"peak {value:.3g}" + ("" if visible else " (behind or inside)"), at, xycoords=inches,
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
