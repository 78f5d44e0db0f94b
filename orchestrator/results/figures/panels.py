"""Figures of several small pictures: the opened structure per load step, and what its interfaces do.

- deformed.png: bodies apart, one panel per load step, all with one exaggeration and one colour scale
- interfaces.png: status and pressure of the interfaces, drawn apart so that inner ones are seen too
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import deformed, surface
from orchestrator.results.figures.look import Look
from orchestrator.results.figures.painting import PAINTED, place, scale, show
from orchestrator.results.figures.plotting import new_figure
from orchestrator.results.figures.skin import Shape
from orchestrator.results.figures.view import WIDTH, Camera, View, colour_limits, viridis
from orchestrator.scene.mesh.geometry import area_vectors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from orchestrator.method.delivery.interface_fields import InterfaceFields

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


def opened(fields: Fields, look: Look = Look(), shape: Shape | None = None, stress: Mapping[int, np.ndarray] | None = None) -> Panels:
    """The deformed structure at each load step, its bodies apart where interfaces have opened; shape and stress as for ``skin``."""
    steps, units = shown_steps(fields), look.units
    views = deformed.views(fields, steps, WIDTH, look, shape, stress)
    flat = views[0].camera.height < 0.45 * views[0].camera.width
    columns = 1 if len(steps) == 1 else 2 if flat or len(steps) in (2, 4) else 3
    exaggeration, *_ = views[0].caption.split("   ·   ")
    largest = max(float(np.linalg.norm(fields.opened.displacement[step], axis=1).max()) for step in steps)
    stress = [view.mark[1] for view in views if view.mark]
    return Panels([replace(view, inches=WIDTH / columns) for view in views], _headings(fields, steps), columns,
                  [(views[0], "von Mises stress" + (units["stress"] and "," + units["stress"]), [])],
                  f"{exaggeration}   ·   largest displacement {largest:.3g}{units['length']}   ·   "
                  f"largest von Mises stress {max(stress, default=0.0):.3g}{units['stress']}")


def interfaces(fields: Fields, look: Look = Look(), imposed: bool = False) -> Panels | None:
    """Status and pressure of the interfaces at each load step, per triangle; None where there are none.

    Those whose jump is imposed, whatever force it takes, have another scale: of them and of the others only one kind is
    drawn, unless there is no other. Where all of a triangle's nodes are open, it is grey.

    Parameters
    ----------
    imposed : whether those are meant; then there must be others too
    """
    from matplotlib.colors import ListedColormap

    i = fields.interfaces
    given = np.array([law in LAWS and LAWS[law].as_one for law in i.laws])
    if given.any() and not given.all():
        i = type(i).joined([i], np.flatnonzero(given == imposed))
    elif imposed:
        return None
    steps = _chosen(fields.steps, _MOST_INTERFACES)
    points = _apart(fields, i)
    corners = points[i.triangles]
    lines = points[surface.edges(points, i.triangles, sharp=180.0)]
    camera = Camera.framing(corners.reshape(-1, 3), direction=look.direction).shaped()
    columns = len(steps) if len(steps) > 1 else 2
    outline = surface.box_edges(fields.nodes) if len(i.names) == 1 else np.empty((0, 2, 3))

    # the middle one of three: what most of the triangle does
    which = np.searchsorted(i.kinds, i.status)
    status = [np.sort(which[step][i.triangles], axis=1)[:, 1] for step in steps]
    parted = np.isin(i.status, i.kinds[i.kind_names == COUNTED[0]])
    pressure = [np.where(parted[step][i.triangles].all(axis=1), np.nan, i.pressure[step][i.triangles].mean(axis=1)) for step in steps]
    area = np.linalg.norm(area_vectors(fields.nodes[i.nodes], i.triangles), axis=1)
    (low, high), _ = colour_limits(np.concatenate(pressure), np.tile(area, len(steps)))
    limits = (min(low, 0.0), max(high, 0.0))  # zero has a place on the scale
    known = np.concatenate(pressure)
    beyond = (bool(np.nanmin(known, initial=0.0) < limits[0]), bool(np.nanmax(known, initial=0.0) > limits[1]))
    palette = ListedColormap(i.kind_colours.tolist())
    triangles = np.arange(corners.size // 3).reshape(-1, 3)
    plain = View(corners.reshape(-1, 3), triangles, np.empty(0), lines, outline, camera, (-0.5, palette.N - 0.5),
                 palette=palette, inches=WIDTH / columns, shaded=False)
    first = [replace(plain, values=np.repeat(value.astype(float), 3)) for value in status]
    second = [replace(plain, values=np.repeat(value, 3), limits=limits, beyond=beyond, palette=viridis())
              for value in pressure]
    moved = "   ·   moved apart, seen from outside" if len(i.names) > 1 else ""
    most, unit = i.friction_traction[steps], look.units["stress"]
    kind = " whose jump is imposed" if imposed else ""
    named = "interface" + "s" * (len(i.names) != 1)
    grey = "   ·   grey: open" if any(np.isnan(value).any() for value in pressure) else ""
    return Panels(first + second, 2 * _headings(fields, steps), columns,
                  [(first[0], "status", i.kind_names.tolist()), (second[0], "pressure" + (unit and "," + unit), [])],
                  f"{len(i.names)} {named}{kind}{moved}   ·   largest pressure {i.pressure[steps].max():.3g}{unit}   ·   "
                  f"largest tangential traction {np.linalg.norm(most, axis=2).max(initial=0.0):.3g}{unit}{grey}")


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
        at = (left, bottom / total, 1 / panels.columns, height / total)
        if pictures:
            place(figure, at, view, pictures[k])
        else:
            show(figure.add_axes(at), view, None)
        figure.text(left + 0.5 / panels.columns, (bottom + height + 0.04) / total, heading,
                    ha="center", va="bottom", fontsize=9)
    share = 1 / len(panels.scales)
    for k, (view, label, names) in enumerate(panels.scales):
        at = ((k + 0.5) * share - 0.2, (_BELOW - 0.2) / total, 0.4, 0.13 / total)
        scale(figure.add_axes(at), view, label, names)
    figure.text(0.5, 1 - 0.12 / total, title, ha="center", va="top", fontsize=12)
    figure.text(0.5, 0.08 / total, panels.caption + ("" if pictures else PAINTED), ha="center", va="bottom",
                fontsize=8.5, color="0.3")
    return figure


def shown_steps(fields: Fields) -> list[int]:
    """The load steps whose deformed structure is drawn."""
    return _chosen(fields.steps, _MOST)


def _chosen(count: int, most: int) -> list[int]:
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def _headings(fields: Fields, steps: list[int]) -> list[str]:
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def _apart(fields: Fields, i: InterfaceFields) -> np.ndarray:
    """(N, 3) where the interfaces' nodes are drawn: each interface moved away from the structure's centre."""
    points = fields.nodes[i.nodes]
    count = np.diff(i.offsets)
    middle = np.add.reduceat(points, i.offsets[:-1]) / count[:, None]
    centre = 0.5 * (fields.nodes.min(axis=0) + fields.nodes.max(axis=0))
    shift = _APART * (middle - centre) * (len(count) > 1)
    return points + shift[i.interface_of_node]
