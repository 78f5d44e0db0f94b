"""Figures of several small pictures: the opened structure per load step, and what its interfaces do.

- deformed.png: bodies apart, one panel per load step, all with one exaggeration and one colour scale
- interfaces.png: status and pressure of the interfaces, drawn apart so that inner ones are seen too
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.results.figures import deformed, surface
from orchestrator.results.figures.deformed import DPI, WIDTH, View
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.plotting import new_figure, png

_MOST = 6  # panels of load steps; of more steps, evenly many are shown
_MOST_INTERFACES = 4  # likewise, above each other: status and pressure
_APART = 0.6  # how far interfaces are moved from the structure's centre, relative to where they are
_HEADING, _BELOW, _ABOVE = 0.26, 0.95, 0.42  # inches over each panel, below and above all


@dataclass(frozen=True)
class Panels:
    """A grid of views, row by row.

    Parameters
    ----------
    views, headings : one each per panel; all views have the same proportions
    columns : of the grid
    scales : the views whose colours are explained below, with label and names of the colours, if they have
    caption : one line below all
    """

    views: list[View]
    headings: list[str]
    columns: int
    scales: list[tuple[View, str, list[str]]]
    caption: str


def opened(fields: Fields) -> Panels:
    """The deformed structure at each load step, its bodies apart where interfaces have opened."""
    steps = _chosen(fields.steps, _MOST)
    views = deformed.views(fields, steps)
    flat = views[0].camera.height < 0.45 * views[0].camera.width
    columns = 1 if len(steps) == 1 else 2 if flat or len(steps) in (2, 4) else 3
    exaggeration, *_ = views[0].caption.split("   ·   ")
    largest = max(float(np.linalg.norm(fields.opened.displacement[step], axis=1).max()) for step in steps)
    stress = max(view.stress.max() for view in views)
    return Panels([replace(view, inches=WIDTH / columns) for view in views], _headings(fields, steps), columns,
                  [(views[0], "von Mises stress", [])],
                  f"{exaggeration}   ·   largest displacement {largest:.3g}   ·   largest von Mises stress {stress:.3g}")


def interfaces(fields: Fields) -> Panels:
    """Status and pressure of the interfaces at each load step, per triangle."""
    i = fields.interfaces
    steps = _chosen(fields.steps, _MOST_INTERFACES)
    corners = _apart(fields)
    camera = deformed.shaped(surface.Camera.framing(corners.reshape(-1, 3)))
    away = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ camera.toward < 0
    corners[away] = corners[away][:, ::-1]  # both sides are looked at
    ends = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    nodes = np.where(away[:, None], i.triangles[:, ::-1], i.triangles)
    lines = ends[_rim(nodes)]
    columns = len(steps) if len(steps) > 1 else 2
    outline = surface.box_edges(fields.nodes) if len(i.names) == 1 else np.empty((0, 2, 3))

    # the middle one of three: what most of the triangle does
    which = np.searchsorted(i.kinds, i.status)
    status = [np.sort(which[step][i.triangles], axis=1)[:, 1] for step in steps]
    pressure = [i.pressure[step][i.triangles].mean(axis=1) for step in steps]
    limits, beyond = deformed.colour_limits(np.concatenate(pressure))
    palette = np.array([[int(colour[k:k + 2], 16) / 255 for k in (1, 3, 5)] for colour in i.kind_colours])
    triangles = np.arange(corners.size // 3).reshape(-1, 3)
    plain = View(corners.reshape(-1, 3), triangles, np.empty(0), lines, outline, camera, (-0.5, len(palette) - 0.5), (False, False),
                 "", palette, WIDTH / columns, shaded=False)
    first = [replace(plain, stress=np.repeat(value.astype(float), 3)) for value in status]
    second = [replace(plain, stress=np.repeat(value, 3), limits=limits, beyond=beyond, palette=deformed.viridis())
              for value in pressure]
    moved = "   ·   moved apart, seen from outside" if len(i.names) > 1 else ""
    most = i.friction_traction[steps]
    return Panels(first + second, 2 * _headings(fields, steps), columns,
                  [(first[0], "status", i.kind_names.tolist()), (second[0], "pressure", [])],
                  f"{len(i.names)} interfaces{moved}   ·   largest pressure {i.pressure[steps].max():.3g}   ·   "
                  f"largest tangential traction {np.linalg.norm(most, axis=2).max(initial=0.0):.3g}")


def compose(panels: Panels, pictures: list[np.ndarray] | None, title: str) -> bytes:
    """PNG of the grid; matplotlib draws the panels where there are no pictures."""
    camera, count = panels.views[0].camera, len(panels.views)
    rows = -(-count // panels.columns)
    width = WIDTH / panels.columns
    height = width * camera.height / camera.width
    total = _ABOVE + rows * (height + _HEADING) + _BELOW
    figure = new_figure(WIDTH, total)
    for k, (view, heading) in enumerate(zip(panels.views, panels.headings)):
        left, bottom = k % panels.columns / panels.columns, total - _ABOVE - (k // panels.columns + 1) * (height + _HEADING)
        axes = figure.add_axes((left, bottom / total, 1 / panels.columns, height / total))
        deformed.show(axes, view, pictures[k] if pictures else None)
        figure.text(left + 0.5 / panels.columns, (bottom + height + 0.04) / total, heading,
                    ha="center", va="bottom", fontsize=9)
    share = 1 / len(panels.scales)
    for k, (view, label, names) in enumerate(panels.scales):
        place = ((k + 0.5) * share - 0.2, (_BELOW - 0.2) / total, 0.4, 0.13 / total)
        bar = figure.colorbar(deformed.colours(view), cax=figure.add_axes(place), orientation="horizontal",
                              extend=("neither", "max", "min", "both")[2 * view.beyond[0] + view.beyond[1]])
        if names:
            bar.set_ticks(range(len(names)), labels=names)
            bar.ax.tick_params(length=0)
        bar.set_label(label, fontsize=9, labelpad=2)
        bar.ax.tick_params(labelsize=8.5)
        bar.outline.set_linewidth(0.5)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, panels.caption + ("" if pictures else deformed.PAINTED), ha="center", va="bottom",
                fontsize=8.5, color="0.3")
    return png(figure, DPI)


def _chosen(count: int, most: int) -> list[int]:
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def _headings(fields: Fields, steps: list[int]) -> list[str]:
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def _apart(fields: Fields) -> np.ndarray:
    """(M, 3, 3) corners of the interfaces' triangles, each interface moved away from the structure's centre."""
    i = fields.interfaces
    points = fields.nodes[i.nodes]
    count = np.diff(i.offsets)
    middle = np.add.reduceat(points, i.offsets[:-1]) / count[:, None]
    centre = 0.5 * (fields.nodes.min(axis=0) + fields.nodes.max(axis=0))
    shift = _APART * (middle - centre) * (len(count) > 1)
    return (points + shift[i.interface_of_node])[i.triangles]


def _rim(triangles: np.ndarray) -> np.ndarray:
    """(3 M,) bool, which edges of the triangles belong to one triangle only."""
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, which, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    return count[which.ravel()] == 1
