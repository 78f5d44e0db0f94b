"""Pictures of the structure: the deformed shape with von Mises stress, and where interfaces are
open, stick or slip.

Where neither a display, EGL nor OSMesa is to be had, VTK ends its process with a segmentation fault
instead of an error: only a process apart from the run may draw here (see ``artist``).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.plotting import (
    DPI, exaggeration, largest_displacement, new_figure, RED, short)
from orchestrator.results.summary.summary import View

if TYPE_CHECKING:
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from pyvista import Plotter, PolyData

WIDTH = 9.0  # of a figure, inches
UNKNOWN = "#bfbfbf"
SHARP = 30.0  # degrees by which faces turn at an edge that is drawn
MARGIN = 1.04  # of a view over what is in it
# share of what is seen that the scale holds, in a view so wide; what is beyond stands out
HIGH, SEEN = 0.99, 400
ABOVE = 1.5  # of that, from which the peak is beyond; else the scale ends there
FLATTEST, TALLEST = 0.25, 0.75  # height of a view over its width


@dataclass(frozen=True)
class Picture:
    """One structure at some load steps, seen by one camera, coloured on one scale.

    surfaces, lines : of each load step, coloured by ``colour``, of points or of faces; nan is grey
    headings : of each load step
    limits : ends of the scale; palette : its colours
    kinds : names of the values 0, 1, 2 …; none: values are a quantity
    label : what the colours say; told : sentences below
    beyond : whether values are beyond the scale, in a colour of its own
    """

    surfaces: Sequence[PolyData]
    lines: Sequence[PolyData]
    headings: Sequence[str]
    limits: tuple[float, float]
    palette: Colormap
    label: str
    told: Sequence[str]
    kinds: Sequence[str] = ()
    beyond: bool = False


def deformed(fields: Fields, s: View) -> Picture | None:
    """Return the deformed surface, coloured by von Mises stress; None where no part has a mesh of
    ours.

    Where no stress is known, colours are the size of the displacement.
    """
    from matplotlib import colormaps

    kept = np.flatnonzero(fields.lame[:, 1] > 0)
    if not len(kept):
        return None
    steps, surface = shown_steps(fields, s), outer_surface(fields, kept)
    factor, most = exaggeration(fields, kept, steps), largest_displacement(fields, kept, steps)
    stress = [fields.nodal.von_mises(step) for step in steps]
    known = bool(np.isfinite(stress).any())
    peak, name, unit = (float(np.nanmax(stress)), "von Mises stress", s.unit["stress"]) if known \
        else (most, "displacement", s.unit["length"])
    moved, place = [], surface["place"]
    for step, values in zip(steps, stress):
        u = fields.opened.displacement[step][fields.nodal.split[0][place]]
        moved.append(surface.copy())
        moved[-1].points = surface.points + factor * u
        moved[-1]["colour"] = values[place] if known else np.linalg.norm(u, axis=1)
    told = [f"displacements × {factor:g}",
            f"largest displacement {short(most)}{s.unit['length']}",
            f"peak {name} {short(peak)}{unit}",
            *["grey: stress not known"] * bool(known and np.isnan(stress).any())]
    return Picture(moved, [edges(shape) for shape in moved], headings(fields, steps),
                   (0.0, peak or 1.0), colormaps["viridis"].with_extremes(over=RED),
                   name + (unit and "," + unit), told)


def interfaces(fields: Fields, s: View) -> Picture | None:
    """Return the interfaces' faces, without the bodies, coloured by status; None where all
    interfaces are perfect.

    The status of a node fills its share of the faces around it. Lines are the edges of the
    undeformed bodies.
    """
    import pyvista
    from matplotlib.colors import ListedColormap

    i = fields.interfaces
    if i is None or not len(i.triangles):
        return None
    steps = shown_steps(fields, s)
    shown = np.flatnonzero(np.isin(i.kinds, i.status[steps]))
    corners = shares(fields.nodes[i.nodes][i.triangles]).reshape(-1, 3)
    faces = pyvista.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3))
    drawn = [faces.copy() for _ in steps]
    for step, one in zip(steps, drawn):
        kind = np.searchsorted(i.kinds[shown], i.status[step])
        one.cell_data["colour"] = np.repeat(kind[i.triangles].ravel(), 2).astype(float)
    lines = edges(outer_surface(fields, np.arange(len(fields.cells))))
    return Picture(drawn, [lines] * len(steps), headings(fields, steps), (-0.5, len(shown) - 0.5),
                   ListedColormap(i.kind_colours[shown].tolist()), "status of interfaces",
                   [f"{len(i.names)} interface{'s' * (len(i.names) != 1)}, undeformed"],
                   i.kind_names[shown].tolist())


def shown_steps(fields: Fields, s: View) -> list[int]:
    """Return the load step of the peak stress, and where interfaces may open the first, that of the
    largest displacement and the last one too.
    """
    farthest = int(np.linalg.norm(fields.displacement, axis=2).max(axis=1).argmax())
    most = s.peak_stress.get("load_step") or 1 + farthest
    others = [] if fields.interfaces is None else [0, farthest, fields.steps - 1]
    return sorted({int(most) - 1, *others})


def headings(fields: Fields, steps: Sequence[int]) -> list[str]:
    """Return what stands above each view."""
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def outer_surface(fields: Fields, kept: np.ndarray) -> PolyData:
    """Return the outer faces of cells (k,) int, each subdomain's by itself; ``place`` of a point is
    its index in ``Nodal.split``.
    """
    import pyvista

    node, cells = fields.nodal.split
    kind = {4: pyvista.CellType.TETRA, 10: pyvista.CellType.QUADRATIC_TETRA}[cells.shape[1]]
    grid = pyvista.UnstructuredGrid({kind: cells[kept].astype(np.int64)},
                                    np.asarray(fields.opened.nodes[node], float))
    grid.point_data["place"] = np.arange(len(node))
    grid.cell_data["subdomain"] = fields.subdomain[kept]
    outer = grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=1,
                                 pass_pointid=False, pass_cellid=False)
    place = np.asarray(outer["place"], np.int64)[outer.regular_faces]
    key = place + len(node) * np.asarray(outer["subdomain"], np.int64)[:, None]
    own, corners = np.unique(key, return_inverse=True)
    surface = pyvista.PolyData.from_regular_faces(grid.points[own % len(node)],
                                                  corners.reshape(-1, 3))
    surface["place"] = own % len(node)
    return surface


def edges(surface: PolyData) -> PolyData:
    """Return the edges where faces turn sharply, and the borders of subdomains."""
    return surface.extract_feature_edges(SHARP, non_manifold_edges=False, manifold_edges=False)


def shares(corners: np.ndarray) -> np.ndarray:
    """Return of triangles (m, 3, 3) what is nearest to each corner, in two triangles: (m, 3, 2, 3,
    3).
    """
    middle = 0.5 * (corners + corners[:, [1, 2, 0]])
    centre = np.broadcast_to(corners.mean(axis=1)[:, None], corners.shape)
    return np.stack([np.stack([corners, middle, centre], axis=2),
                     np.stack([corners, centre, middle[:, [2, 0, 1]]], axis=2)], axis=2)


@cache
def _window() -> Plotter:
    """Return a window that is never shown, for all pictures of this process: to open it takes
    longer than to draw.
    """
    import pyvista

    if not os.environ.get("DISPLAY"):  # otherwise VTK tries X first and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    plotter = pyvista.Plotter(off_screen=True, lighting="none", window_size=(16, 16),
                              theme=pyvista.themes.DocumentTheme())
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.enable_parallel_projection()
    plotter.show(auto_close=False)
    return plotter


def draw(picture: Picture, step: int, width: int) -> np.ndarray:
    """Return (rows, width, 3) uint8, the view of one of the load steps."""
    plotter, light = _window(), not picture.kinds
    focus, toward, up, extent = _camera(
        np.concatenate([shape.points for shape in (*picture.surfaces, *picture.lines)]))
    plotter.clear_actors()
    plotter.render_window.SetSize(width, round(width * extent[1] / extent[0]))
    plotter.add_mesh(picture.surfaces[step], scalars="colour", cmap=picture.palette,
                     clim=picture.limits, nan_color=UNKNOWN,
                     interpolate_before_map=True, above_color=RED if picture.beyond else None,
                     show_scalar_bar=False, lighting=light, ambient=0.75 if light else 1.0,
                     diffuse=0.3 * light, reset_camera=False, render=False)
    if picture.lines[step].n_points:
        actor = plotter.add_mesh(picture.lines[step], color="black", opacity=0.45, lighting=False,
                                 line_width=max(1.0, width / 900),
                                 reset_camera=False, render=False)
        actor.mapper.resolve = "polygon_offset"  # a hair nearer than the faces they lie on
        actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
    plotter.camera_position = [focus + extent.max() * toward, focus, up]
    plotter.camera.parallel_scale = 0.5 * extent[1]
    plotter.reset_camera_clipping_range()
    plotter.render()
    return plotter.screenshot(return_img=True)


def _camera(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the middle of the view (3,), unit vectors to the eye and upward (3,), width and height
    of what holds points (n, 3).

    It looks from the front, the right and above; slender bodies lie across the picture.
    """
    span = np.ptp(points, axis=0)
    slender = np.sort(span)[2] > 3 * np.sort(span)[1]
    toward = [(0.45, -1.0, 0.45), (1.0, -0.45, 0.45),
              (0.7, -1.0, 0.3)][int(span.argmax())] if slender else (0.75, -1.0, 0.6)
    toward = np.array(toward) / np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(toward, right), toward])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    width, height = MARGIN * np.maximum((high - low)[:2], 1e-9 * span.max())
    ratio = min(max(height / width, FLATTEST), TALLEST)
    return 0.5 * (low + high) @ axes, toward, axes[1], np.array(
        [max(width, height / ratio), max(height, width * ratio)])


def fitted(picture: Picture) -> Picture:
    """Return the picture with a scale that holds ``HIGH`` of what is seen of a quantity.

    A peak inside, or at an edge, leaves the rest its colours; what is beyond has one of its own.
    """
    import pyvista
    from matplotlib import colormaps

    steps, peak = range(len(picture.surfaces)), picture.limits[1]
    none = [pyvista.PolyData() for _ in steps]
    grey = replace(picture, palette=colormaps["gray_r"], kinds=("",), lines=none,
                   limits=(-0.1 * peak, peak))  # none is as white as the ground
    seen = 255 - np.array([draw(grey, step, SEEN)[..., 0] for step in steps])
    level = float(np.quantile(np.append(seen[seen > 0], 255), HIGH)) / 255
    top = peak * max(1.1 * level - 0.1, 0.01)
    return replace(picture, limits=(0.0, top), beyond=True) if peak > ABOVE * top else picture


def compose(picture: Picture, title: str) -> Figure:
    """Return the figure: views below each other or in two columns, the scale and what is told
    below.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    picture = picture if picture.kinds else fitted(picture)
    count = len(picture.surfaces)
    columns = min(2, count)
    views = [draw(picture, step, int(WIDTH / columns * DPI)) for step in range(count)]
    rows, ratio = -(-count // columns), views[0].shape[0] / views[0].shape[1]
    figure = new_figure(WIDTH, rows * (WIDTH / columns * ratio + 0.3) + 1.3)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.axis("off")
    for axes, view, heading in zip(panels, views, picture.headings):
        axes.imshow(view)
        axes.set_title(heading, fontsize=9)
    figure.suptitle(title + "\n", fontsize=12)
    figure.text(0.5, 1 - 0.42 / figure.get_figheight(), "   ·   ".join(picture.told), ha="center",
                va="bottom", fontsize=8.5)
    if picture.kinds:
        figure.legend(handles=[Patch(color=picture.palette(k), label=name)
                               for k, name in enumerate(picture.kinds)],
                      title=picture.label, fontsize=8.5, frameon=False, loc="outside lower center",
                      ncols=len(picture.kinds))
    else:
        ticks = np.linspace(*picture.limits, 5)
        bar = figure.colorbar(ScalarMappable(Normalize(*picture.limits), picture.palette),
                              ax=panels.tolist(), location="bottom",
                              extend="max" if picture.beyond else "neither",
                              shrink=0.6, aspect=40, label=picture.label)
        bar.set_ticks(ticks, labels=list(map(short, ticks)))
    return figure
