"""What interfaces do, drawn apart so that inner ones are seen too: interfaces.png, and jumps.png where jumps are imposed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.deformed import headings, spread
from orchestrator.results.figures.plotting import viridis
from orchestrator.results.figures.sheet import Scale, Sheet
from orchestrator.results.figures.view import Camera, Look, NO_LINES, View, colour_limits
from orchestrator.scene.mesh.geometry import area_vectors

if TYPE_CHECKING:
    from matplotlib.colors import ListedColormap

    from orchestrator.method.delivery.interface_fields import InterfaceFields

_MOST = 4  # load steps, status above pressure; of more steps, evenly many are shown
_APART = 0.6  # how far interfaces are moved from the structure's centre, relative to where they are


def interfaces(fields: Fields, look: Look = Look(), imposed: bool = False) -> Sheet | None:
    """Status and pressure of the interfaces at each load step, per triangle; None where there are none.

    Those whose jump is imposed, whatever force it takes, have another scale: of them and of the others only one kind is
    drawn, unless there is no other. Where all of a triangle's nodes are open, it is grey.

    imposed : whether those are meant; then there must be others too
    """
    i = _chosen(fields.interfaces, imposed)
    if i is None:
        return None
    steps = spread(fields.steps, _MOST)
    points = _apart(fields, i)
    corners = points[i.triangles].reshape(-1, 3)
    shared = {"lines": points[surface.edges(points, i.triangles, sharp=180.0)], "shaded": False,
              "outline": surface.box_edges(fields.nodes) if len(i.names) == 1 else NO_LINES}
    triangles, camera = np.arange(len(corners)).reshape(-1, 3), Camera.framing(corners, look.direction)
    status, palette = _status(i, steps), _kinds(i)
    pressure, limits, beyond = _pressure(fields, i, steps)
    views = [View(corners, triangles, np.repeat(values, 3), camera, (-0.5, palette.N - 0.5), palette=palette, **shared)
             for values in status]
    views += [View(corners, triangles, np.repeat(values, 3), camera, limits, beyond, palette=viridis(), **shared) for values in pressure]
    unit, count = look.units["stress"], len(i.names)
    told = [f"{count} interface{'s' * (count != 1)}" + " whose jump is imposed" * imposed,
            *["moved apart, seen from outside"] * (count > 1), f"largest pressure {i.pressure[steps].max():.3g}{unit}",
            f"largest tangential traction {np.linalg.norm(i.friction_traction[steps], axis=2).max(initial=0.0):.3g}{unit}",
            *["grey: open"] * bool(np.isnan(pressure).any())]
    return Sheet(views, 2 * headings(fields, steps), max(len(steps), 2), [
        Scale(views[0], "status", i.kind_names.tolist()), Scale(views[-1], "pressure" + (unit and "," + unit))], "   ·   ".join(told))


def _chosen(i: InterfaceFields | None, imposed: bool) -> InterfaceFields | None:
    if i is None:
        return None
    given = np.array([law in LAWS and LAWS[law].as_one for law in i.laws])
    if given.any() and not given.all():
        return type(i).joined([i], np.flatnonzero(given == imposed))
    return None if imposed else i


def _kinds(i: InterfaceFields) -> ListedColormap:
    from matplotlib.colors import ListedColormap

    return ListedColormap(i.kind_colours.tolist())


def _status(i: InterfaceFields, steps: list[int]) -> np.ndarray:
    """(steps, triangles) the middle one of three: what most of the triangle does."""
    return np.sort(np.searchsorted(i.kinds, i.status)[steps][:, i.triangles], axis=2)[:, :, 1].astype(float)


def _pressure(fields: Fields, i: InterfaceFields, steps: list[int]) -> tuple[np.ndarray, tuple[float, float], tuple[bool, bool]]:
    """(steps, triangles), nan where open; limits of its scale, on which zero has a place, and whether values lie beyond."""
    parted = np.isin(i.status, i.kinds[i.kind_names == COUNTED[0]])[steps][:, i.triangles].all(axis=2)
    pressure = np.where(parted, np.nan, i.pressure[steps][:, i.triangles].mean(axis=2))
    area = np.linalg.norm(area_vectors(fields.nodes[i.nodes], i.triangles), axis=1)
    (low, high), _ = colour_limits(pressure.ravel(), np.tile(area, len(steps)))
    limits = min(low, 0.0), max(high, 0.0)
    return pressure, limits, (bool(np.nanmin(pressure, initial=0.0) < limits[0]), bool(np.nanmax(pressure, initial=0.0) > limits[1]))


def _apart(fields: Fields, i: InterfaceFields) -> np.ndarray:
    """(N, 3) where the interfaces' nodes are drawn: each interface moved away from the structure's centre."""
    points, count = fields.nodes[i.nodes], np.diff(i.offsets)
    middle = np.add.reduceat(points, i.offsets[:-1]) / count[:, None]
    centre = 0.5 * (fields.nodes.min(axis=0) + fields.nodes.max(axis=0))
    return points + (_APART * (middle - centre) * (len(count) > 1))[i.interface_of_node]
