"""Pictures of the structure: deformed.png with von Mises stress, codes.png coloured by the code that solves each part; interfaces.png
and jumps.png, where interfaces are drawn apart so that inner ones are seen too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.plotting import viridis
from orchestrator.results.figures.sheet import Scale, Sheet
from orchestrator.results.figures.surface import Skin, drawn_cells, skin
from orchestrator.results.figures.view import Camera, Look, NO_LINES, View, colour_limits, toward_eye
from orchestrator.results.summary.summary import code_label
from orchestrator.scene.mesh.geometry import area_vectors

if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields

_MOST = 6  # pictures of load steps; of more steps, evenly many are shown
_LARGEST = 0.1  # largest drawn displacement over the structure's size
_OPENING, _FARTHEST = 0.03, 0.25  # the same for the largest opening, and the limit to which it may raise the other
# blue, orange, green, purple, sky, red: told apart by the colour-blind
PALETTE = ["#598cbf", "#ed9e40", "#59a673", "#9e73ad", "#8cc7e6", "#cc594d"]


def most_deformed(fields: Fields) -> int:
    """The load step with the largest displacement."""
    return int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))


def spread(count: int, most: int) -> list[int]:
    """At most ``most`` of ``count`` load steps, first and last among them."""
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def shown_steps(fields: Fields) -> list[int]:
    """The load steps that are drawn: the most deformed one, where interfaces open all or evenly many."""
    return [most_deformed(fields)] if fields.interfaces is None else spread(fields.steps, _MOST)


def headings(fields: Fields, steps: Sequence[int]) -> list[str]:
    """Above the pictures of load steps."""
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def exaggeration(fields: Fields, steps: Sequence[int]) -> float:
    """Factor that shows the displacements, and the openings where there are any."""
    size, largest, i = float(np.linalg.norm(np.ptp(fields.nodes, axis=0))), max(_largest(fields, steps)), fields.interfaces
    if largest == 0:
        return 1.0
    factor, opening = _LARGEST * size / largest, 0.0 if i is None else float((i.gap - i.initial_gap)[list(steps)].max(initial=0.0))
    if opening > 0:
        factor = max(factor, min(_OPENING * size / opening, _FARTHEST * size / largest))
    return float(f"{factor:.1e}")


def _largest(fields: Fields, steps: Sequence[int]) -> list[float]:
    """Per load step the largest displacement of what is ours: cells may stand for parts whose mesh is another program's."""
    drawn = fields.opened
    ours = np.unique(drawn.cells[drawn.lame[:, 1] > 0])
    return [float(np.linalg.norm(drawn.displacement[step][ours], axis=1).max(initial=0.0)) for step in steps]


def deformed(fields: Fields, look: Look = Look()) -> Sheet | None:
    """The deformed surface at ``shown_steps``: one camera, one exaggeration, one colour scale; bodies apart where interfaces opened.

    None where there is no part to draw that has a mesh of ours.
    """
    if not len(drawn_cells(fields, look)):
        return None
    steps, units = shown_steps(fields), look.units
    factor, toward = exaggeration(fields, steps), toward_eye(fields.nodes) if look.direction is None else look.direction
    seen = skin(fields, steps, look, toward)
    moved = {step: seen.points + factor * seen.displacement[step] for step in steps}
    own = toward if look.cut is not None or look.direction is not None else None
    camera = Camera.framing(np.concatenate([*moved.values(), seen.outline.reshape(-1, 3)]), own)
    limits, beyond = stress_limits(seen)
    views = [View(moved[step], seen.triangles, seen.stress[step], camera, limits, beyond, moved[step][seen.lines], seen.outline,
                  closed=look.cut is None, mark=_mark(seen.peaks[step], factor, moved[step], seen.triangles, camera)) for step in steps]
    flat, count = camera.height < 0.45 * camera.width, len(steps)
    peaks = [peak[1] for peak in seen.peaks.values() if peak is not None]
    told = [f"displacements drawn × {factor:g}", f"largest displacement {max(_largest(fields, steps)):.3g}{units['length']}",
            f"largest von Mises stress {max(peaks):.3g}{units['stress']}" if peaks else "stress not known (grey)",
            *([f"cut at {'xyz'[look.cut[0]]} = {look.cut[1]:g}"] if look.cut is not None else [])]
    return Sheet(views, headings(fields, steps), 1 if count == 1 else 2 if flat or count in (2, 4) else 3,
                 [Scale(views[0], "von Mises stress" + (units["stress"] and "," + units["stress"]))] * bool(peaks), "   ·   ".join(told))


def stress_limits(seen: Skin) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """``colour_limits`` of the stress at all its load steps, each point with its share of the surface."""
    area = np.linalg.norm(area_vectors(seen.points, seen.triangles), axis=1)
    weight = np.bincount(seen.triangles.ravel(), np.repeat(area / 3, 3), minlength=len(seen.points))
    return colour_limits(np.concatenate(list(seen.stress.values())), np.tile(weight, len(seen.stress)))


def _mark(peak: tuple[np.ndarray, float] | None, factor: float, points: np.ndarray, triangles: np.ndarray,
          camera: Camera) -> tuple[np.ndarray, float, bool] | None:
    """Where the largest stress is, for the picture; faces turned to the eye are taken for visible."""
    if peak is None or not peak[1] > 0:
        return None
    (place, displacement), value = peak
    at = place + factor * displacement
    near = np.linalg.norm(points - at, axis=1) <= 1e-9 * max(camera.width, camera.height)
    around = triangles[near[triangles].any(axis=1)]
    return at, value, bool((area_vectors(points, around) @ camera.toward > 0).any())


def codes(fields: Fields, summary: Mapping[str, object]) -> Sheet | None:
    """The most deformed load step, coloured by code; None where there is one code."""
    from matplotlib.colors import ListedColormap

    entries, cells = summary.get("codes") or [], drawn_cells(fields, Look())
    if len(entries) < 2 or not len(cells):
        return None
    step, drawn = most_deformed(fields), fields.opened
    factor = exaggeration(fields, [step])
    of_subdomain = np.zeros(int(fields.subdomain.max()) + 1)
    for number, entry in enumerate(entries):
        of_subdomain[entry["subdomains"]] = number
    faces, cell = surface.outer_faces(drawn.nodes, drawn.cells)
    moved = drawn.nodes + factor * drawn.displacement[step]
    points = moved[faces].reshape(-1, 3)  # none shared: no colours between those of the codes
    view = View(points, np.arange(len(points)).reshape(-1, 3), np.repeat(of_subdomain[fields.subdomain[cell]], 3), Camera.framing(points),
                (-0.5, len(entries) - 0.5), lines=moved[surface.edges(drawn.nodes, faces, fields.subdomain[cell])],
                palette=ListedColormap([PALETTE[k % len(PALETTE)] for k in range(len(entries))]))
    return Sheet([view], [""], 1, [Scale(view, "which code solves what", list(map(code_label, entries)))],
                 f"displacements drawn × {factor:g}")


_MOST_APART = 4  # load steps, status above pressure; of more steps, evenly many are shown
_APART = 0.6  # how far interfaces are moved from the structure's centre, relative to where they are


def interfaces(fields: Fields, look: Look = Look(), imposed: bool = False) -> Sheet | None:
    """Status and pressure of the interfaces at each load step, per triangle; None where there are none.

    Those whose jump is imposed, whatever force it takes, have another scale: of them and of the others only one kind is
    drawn, unless there is no other. Where all of a triangle's nodes are open, it is grey.

    imposed : whether those are meant; then there must be others too
    """
    from matplotlib.colors import ListedColormap

    i = _chosen(fields.interfaces, imposed)
    if i is None:
        return None
    steps = spread(fields.steps, _MOST_APART)
    points = _apart(fields, i)
    corners = points[i.triangles].reshape(-1, 3)
    shared = {"lines": points[surface.edges(points, i.triangles, sharp=180.0)], "shaded": False,
              "outline": surface.box_edges(fields.nodes) if len(i.names) == 1 else NO_LINES}
    triangles, camera = np.arange(len(corners)).reshape(-1, 3), Camera.framing(corners, look.direction)
    # of three the middle one: what most of the triangle does
    status = np.sort(np.searchsorted(i.kinds, i.status)[steps][:, i.triangles], axis=2)[:, :, 1].astype(float)
    palette = ListedColormap(i.kind_colours.tolist())
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
