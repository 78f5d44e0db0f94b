"""Figures of several small pictures: the opened structure per load step, and what its interfaces do.

- deformed.png: bodies apart, one panel per load step, all with one exaggeration and one colour scale
- interfaces.png: status and pressure of the interfaces, drawn apart so that inner ones are seen too
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import deformed, surface
from orchestrator.results.figures.painting import PAINTED, scale, show
from orchestrator.results.figures.plotting import new_figure
from orchestrator.results.figures.view import WIDTH, Camera, View, colour_limits, viridis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    stress = max(view.values.max() for view in views)
    return Panels([replace(view, inches=WIDTH / columns) for view in views], _headings(fields, steps), columns,
                  [(views[0], "von Mises stress", [])],
                  f"{exaggeration}   ·   largest displacement {largest:.3g}   ·   largest von Mises stress {stress:.3g}")


def interfaces(fields: Fields) -> Panels:
    """Status and pressure of the interfaces at each load step, per triangle."""
    from matplotlib.colors import ListedColormap

    i = fields.interfaces
    steps = _chosen(fields.steps, _MOST_INTERFACES)
    points = _apart(fields)
    corners = points[i.triangles]
    lines = points[surface.edges(points, i.triangles, sharp=180.0)]
    camera = Camera.framing(corners.reshape(-1, 3)).shaped()
    columns = len(steps) if len(steps) > 1 else 2
    outline = surface.box_edges(fields.nodes) if len(i.names) == 1 else np.empty((0, 2, 3))

    # the middle one of three: what most of the triangle does
    which = np.searchsorted(i.kinds, i.status)
    status = [np.sort(which[step][i.triangles], axis=1)[:, 1] for step in steps]
    pressure = [i.pressure[step][i.triangles].mean(axis=1) for step in steps]
    limits, beyond = colour_limits(np.concatenate(pressure))
    palette = ListedColormap(i.kind_colours.tolist())
    triangles = np.arange(corners.size // 3).reshape(-1, 3)
    plain = View(corners.reshape(-1, 3), triangles, np.empty(0), lines, outline, camera, (-0.5, palette.N - 0.5),
                 palette=palette, inches=WIDTH / columns, shaded=False)
    first = [replace(plain, values=np.repeat(value.astype(float), 3)) for value in status]
    second = [replace(plain, values=np.repeat(value, 3), limits=limits, beyond=beyond, palette=viridis())
              for value in pressure]
    moved = "   ·   moved apart, seen from outside" if len(i.names) > 1 else ""
    most = i.friction_traction[steps]
    return Panels(first + second, 2 * _headings(fields, steps), columns,
                  [(first[0], "status", i.kind_names.tolist()), (second[0], "pressure", [])],
                  f"{len(i.names)} interfaces{moved}   ·   largest pressure {i.pressure[steps].max():.3g}   ·   "
                  f"largest tangential traction {np.linalg.norm(most, axis=2).max(initial=0.0):.3g}")


def compose(panels: Panels, pictures: list[np.ndarray] | None, title: str) -> Figure:
    """The grid; matplotlib draws the panels where there are no pictures."""
    camera, count = panels.views[0].camera, len(panels.views)
    rows = -(-count // panels.columns)
    width = WIDTH / panels.columns
    height = width * camera.height / camera.width
    total = _ABOVE + rows * (height + _HEADING) + _BELOW
    figure = new_figure(WIDTH, total)
    for k, (view, heading) in enumerate(zip(panels.views, panels.headings)):
        left, bottom = k % panels.columns / panels.columns, total - _ABOVE - (k // panels.columns + 1) * (height + _HEADING)
        axes = figure.add_axes((left, bottom / total, 1 / panels.columns, height / total))
        show(axes, view, pictures[k] if pictures else None)
        figure.text(left + 0.5 / panels.columns, (bottom + height + 0.04) / total, heading,
                    ha="center", va="bottom", fontsize=9)
    share = 1 / len(panels.scales)
    for k, (view, label, names) in enumerate(panels.scales):
        place = ((k + 0.5) * share - 0.2, (_BELOW - 0.2) / total, 0.4, 0.13 / total)
        scale(figure.add_axes(place), view, label, names)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, panels.caption + ("" if pictures else PAINTED), ha="center", va="bottom",
                fontsize=8.5, color="0.3")
    return figure


def _chosen(count: int, most: int) -> list[int]:
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def _headings(fields: Fields, steps: list[int]) -> list[str]:
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def _apart(fields: Fields) -> np.ndarray:
    """(N, 3) where the interfaces' nodes are drawn: each interface moved away from the structure's centre."""
    i = fields.interfaces
    points = fields.nodes[i.nodes]
    count = np.diff(i.offsets)
    middle = np.add.reduceat(points, i.offsets[:-1]) / count[:, None]
    centre = 0.5 * (fields.nodes.min(axis=0) + fields.nodes.max(axis=0))
    shift = _APART * (middle - centre) * (len(count) > 1)
    return points + shift[i.interface_of_node]
