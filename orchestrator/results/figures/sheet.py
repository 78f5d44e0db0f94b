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

from orchestrator.results.figures.plotting import DPI, new_figure, short
from orchestrator.results.figures.view import WIDTH, View

if TYPE_CHECKING:
    from matplotlib.artist import Artist as MatplotlibArtist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform
    from pyvista import Plotter

_HEADING, _BELOW, _ABOVE = 0.26, 0.95, 0.42  # inches over each picture that has a heading, below and above all
_SCALE, _LINE = 0.55, 0.16  # inches of a colour scale, of a further line of the caption
_TICK = 0.6  # inches between numbers of a scale, at least
_LETTERS = 135  # of a line of the caption
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
    scales : beside each other below the grid; as many as views, where that is more than one: each below its own
    told : what the caption below all says
    """

    views: Sequence[View]
    headings: Sequence[str]
    columns: int
    scales: Sequence[Scale]
    told: Sequence[str]

    @property
    def caption(self) -> str:
        """The caption in lines that are not wider than the figure."""
        lines = [""]
        for text in self.told:
            longer = f"{lines[-1]}   ·   {text}" if lines[-1] else text
            lines = [*lines[:-1], longer] if len(longer) <= _LETTERS else [*lines, text]
        return "\n".join(lines)


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
    width, heading, own = WIDTH / sheet.columns, _HEADING * any(sheet.headings), len(sheet.scales) == len(sheet.views) > 1
    height, room = width * camera.height / camera.width, heading + _SCALE * own
    below = _BELOW + _LINE * sheet.caption.count("\n") - _SCALE * own
    total = _ABOVE + rows * (height + room) + below
    figure = new_figure(WIDTH, total)
    for k, (view, text) in enumerate(zip(sheet.views, sheet.headings)):
        row, column = divmod(k, sheet.columns)
        left, bottom = column * width, total - _ABOVE - (row + 1) * (height + room) + _SCALE * own
        figure.add_artist(_exactly(figure, draw(view, width), round(left * DPI), round(bottom * DPI)))
        if view.mark is not None:
            _point_at(figure, view, left, bottom, width)
        for at, name in view.names:  # below each
            x, y = view.camera.project(at)[:2] / view.camera.width * width
            figure.text((left + x + 0.5 * width) / WIDTH, (bottom + y + 0.5 * height - 0.03) / total, name, ha="center", va="top",
                        fontsize=6.5, color="0.25", linespacing=1.15)
        figure.text((left + 0.5 * width) / WIDTH, (bottom + height + 0.04) / total, text, ha="center", va="bottom", fontsize=9)
        if own:
            place = (left + 0.2 * width) / WIDTH, (bottom - 0.15) / total, 0.6 / sheet.columns, 0.1 / total
            _scale(figure.add_axes(place), sheet.scales[k])
    for k, scale in enumerate(() if own else sheet.scales):
        wide = 0.7 / len(sheet.scales) if scale.names or len(sheet.scales) > 1 else 0.5
        _scale(figure.add_axes(((k + 0.5) / len(sheet.scales) - 0.5 * wide, (below - 0.2) / total, wide, 0.13 / total)), scale)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, sheet.caption, ha="center", va="bottom", fontsize=8.5, color="0.3")
    return figure


def _exactly(figure: Figure, picture: np.ndarray, left: int, bottom: int) -> MatplotlibArtist:
    """The picture, dot for dot: matplotlib's own images are sampled anew, which takes as long as to draw them."""
    from matplotlib.image import FigureImage

    class Dots(FigureImage):
        def make_image(self, *_: object, **__: object) -> tuple[np.ndarray, int, int, None]:
            return self.get_array(), left, bottom, None

    dots = Dots(figure, zorder=-1)
    opaque = np.full((*picture.shape[:2], 1), 255, dtype=np.uint8)
    dots.set_data(np.ascontiguousarray(np.concatenate([picture, opaque], axis=2)[::-1]))  # matplotlib's rows go upward
    return dots


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
    figure.add_artist(Annotation(f"peak {short(value)}" + ("" if visible else ", hidden"), at, xycoords=inches,
        xytext=(-12 if x > 0 else 12, -14 if y > 0 else 14), textcoords="offset points",
        ha="right" if x > 0 else "left", va="top" if y > 0 else "bottom", fontsize=8.5,
        color=_MARK_TEXT, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}))


def _scale(axes: Axes, scale: Scale) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    view = scale.view
    lowest, highest = view.extremes or view.limits
    below, above = lowest < view.limits[0], highest > view.limits[1]
    bar = axes.figure.colorbar(ScalarMappable(Normalize(*view.limits), view.palette), cax=axes, orientation="horizontal",
                               extend=("neither", "max", "min", "both")[2 * below + above])
    for beyond, value, place, side in ((below, lowest, -0.06, "right"), (above, highest, 1.06, "left")):
        if beyond:
            bar.ax.text(place, 0.5, short(value), transform=bar.ax.transAxes, ha=side, va="center", fontsize=8.5)
    bar.set_label(scale.label, fontsize=9, labelpad=2)
    bar.ax.tick_params(labelsize=8.5)
    bar.ax.xaxis.set_major_locator(MaxNLocator(axes.get_position().width * WIDTH / _TICK, steps=[1, 2, 2.5, 5, 10]))
    bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.outline.set_linewidth(0.5)
    if scale.names:
        bar.set_ticks(range(len(scale.names)), labels=scale.names)
        bar.ax.tick_params(length=0)
