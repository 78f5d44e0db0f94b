"""Pictures of the structure: deformed.png with von Mises stress, codes.png coloured by the code that solves each part; interfaces.png
and jumps.png, where interfaces are laid flat so that inner ones are seen too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.method.events import COUNTED
from orchestrator.registry import LAWS
from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.exaggeration import exaggeration, largest_displacements, misfit
from orchestrator.results.figures.flat import laid_flat, shares
from orchestrator.results.figures.plotting import short, viridis
from orchestrator.results.figures.sheet import Scale, Sheet
from orchestrator.results.figures.surface import Skin, drawn_cells, skin
from orchestrator.results.figures.view import Camera, Look, View, colour_limits, toward_eye
from orchestrator.results.summary.summary import code_label
from orchestrator.scene.mesh.geometry import area_vectors, areas

if TYPE_CHECKING:
    from orchestrator.method.delivery.interface_fields import InterfaceFields

_MOST = 6  # pictures of load steps; of more steps, evenly many are shown
EQUAL = 1e-6  # of the largest: no difference to show
# blue, orange, green, purple, sky, red: told apart by the colour-blind
PALETTE = ["#598cbf", "#ed9e40", "#59a673", "#9e73ad", "#8cc7e6", "#cc594d"]


def most_deformed(fields: Fields) -> int:
    """The load step with the largest displacement."""
    return int(np.argmax(np.abs(fields.displacement).max(axis=(1, 2))))


def spread(count: int, most: int, largest: int) -> list[int]:
    """At most ``most`` (3 or more) of ``count`` load steps, first, last and the one of what is ``largest`` among them."""
    chosen = sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
    if largest not in chosen:  # in place of the nearest one between first and last
        chosen[1 + int(np.abs(np.array(chosen[1:-1]) - largest).argmin())] = largest
    return sorted(chosen)


def shown_steps(fields: Fields, look: Look) -> list[int]:
    """The load steps that are drawn: those asked for; else the most deformed one, where interfaces open all or evenly many."""
    largest = most_deformed(fields)
    return look.of_steps(fields.steps) or ([largest] if fields.interfaces is None else spread(fields.steps, _MOST, largest))


def omitted(fields: Fields, steps: Sequence[int]) -> list[str]:
    """Words of the caption where load steps are not drawn."""
    left = [str(step + 1) for step in range(fields.steps) if step not in steps]
    return [f"load step{'s' * (len(left) > 1)} {', '.join(left) if len(left) <= 8 else f'{left[0]} … {left[-1]}'} not drawn"] * bool(left)


def headings(fields: Fields, steps: Sequence[int]) -> list[str]:
    """Above the pictures of load steps."""
    return [f"load step {step + 1} of {fields.steps}" if fields.steps > 1 else "" for step in steps]


def deformed(fields: Fields, look: Look = Look()) -> Sheet | None:
    """The deformed surface at ``shown_steps``: one camera, one exaggeration, one colour scale; bodies apart where interfaces opened.

    Colours are those of von Mises stress, where none is known of the size of the displacement. None where there is no part to draw
    that has a mesh of ours.
    """
    if not len(drawn_cells(fields, look)):
        return None
    steps, units = shown_steps(fields, look), look.units
    factor, toward = exaggeration(fields, steps), toward_eye(fields.nodes) if look.direction is None else look.direction
    seen = skin(fields, steps, look, toward)
    moved = {step: seen.points + factor * seen.displacement[step] for step in steps}
    own = toward if look.cut is not None or look.direction is not None else None
    camera = Camera.framing(np.concatenate([*moved.values(), seen.outline.reshape(-1, 3)]), own)
    peaks = [peak[1] for peak in seen.peaks.values() if peak is not None]
    values = seen.stress if peaks else {step: np.linalg.norm(u, axis=1) for step, u in seen.displacement.items()}
    limits = limits_at(seen, values, steps, look.scale)
    views = [View(moved[step], seen.triangles, values[step], camera, *limits[step], moved[step][seen.lines], seen.outline,
                  closed=look.cut is None, mark=_mark(seen, step, factor, moved[step], camera)) for step in steps]
    flat, count, largest = camera.height < 0.45 * camera.width, len(steps), short(max(largest_displacements(fields, steps)))
    apart = misfit(fields, steps, factor)
    told = [f"displacements drawn × {factor:g}", f"largest displacement {largest}{units['length']}",
            f"largest von Mises stress {short(max(peaks))}{units['stress']}" if peaks else "stress not known",
            *["grey: stress not known"] * bool(peaks and any(np.isnan(found).any() for found in values.values())),
            *[f"faces that touch drawn up to {short(apart)}{units['length']} apart"] * (apart > 0),
            *([f"cut at {'xyz'[look.cut[0]]} = {look.cut[1]:g}"] if look.cut is not None else []), *omitted(fields, steps)]
    name, unit = ("von Mises stress", units["stress"]) if peaks else ("displacement", units["length"])
    return Sheet(views, headings(fields, steps), 1 if count == 1 else 2 if flat or count in (2, 4) else 3,
                 [Scale(view, name + (unit and "," + unit)) for view in (views if look.scale == "step" else views[:1])], told)


def limits_at(seen: Skin, values: Mapping[int, np.ndarray], steps: Sequence[int],
              scale: tuple[float, float] | str | None) -> dict[int, tuple[tuple[float, float], tuple[float, float]]]:
    """Per load step the ends of its colours and the lowest and highest value: of all steps together, unless each has its own.

    Each point of the surface stands for its share of it, see ``colour_limits``.
    """
    area = areas(seen.points, seen.triangles)
    weight = np.bincount(seen.triangles.ravel(), np.repeat(area / 3, 3), minlength=len(seen.points))
    if scale == "step":
        return {step: colour_limits(values[step], weight) for step in steps}
    ends, extremes = colour_limits(np.concatenate([values[step] for step in steps]), np.tile(weight, len(steps)))
    inside = [seen.peaks[step][1] for step in steps if seen.peaks[step] is not None]  # a peak that is not on the surface counts too
    return dict.fromkeys(steps, (ends if scale is None else scale, (extremes[0], max(extremes[1], *inside, extremes[1]))))


def _mark(seen: Skin, step: int, factor: float, points: np.ndarray, camera: Camera) -> tuple[np.ndarray, float, bool] | None:
    """Place of the largest stress; faces turned to the eye are taken for visible. None of a stress that is zero, or everywhere the same."""
    most = max((peak[1] for peak in seen.peaks.values() if peak is not None), default=0.0)
    if seen.peaks[step] is None or not seen.peaks[step][1] > EQUAL * most or np.nanmin(seen.stress[step]) > (1 - EQUAL) * most:
        return None
    (place, displacement), value = seen.peaks[step]
    at = place + factor * displacement
    near = np.linalg.norm(points - at, axis=1) <= 1e-9 * max(camera.width, camera.height)
    around = seen.triangles[near[seen.triangles].any(axis=1)]
    return at, value, bool((area_vectors(points, around) @ camera.toward > 0).any())


def codes(fields: Fields, summary: Mapping[str, object]) -> Sheet | None:
    """The structure as it was before it deformed, coloured by code; None where there is one code."""
    from matplotlib.colors import ListedColormap

    entries, cells = summary.get("codes") or [], drawn_cells(fields, Look())
    if len(entries) < 2 or not len(cells):
        return None
    of_subdomain = np.zeros(int(fields.subdomain.max()) + 1)
    for number, entry in enumerate(entries):
        of_subdomain[entry["subdomains"]] = number
    faces, cell = surface.outer_faces(fields.opened.nodes, fields.opened.cells)
    nodes = fields.opened.nodes
    points = nodes[faces].reshape(-1, 3)  # none shared: no colours between those of the codes
    view = View(points, np.arange(len(points)).reshape(-1, 3), np.repeat(of_subdomain[fields.subdomain[cell]], 3), Camera.framing(points),
                (-0.5, len(entries) - 0.5), lines=nodes[surface.edges(nodes, faces, fields.subdomain[cell])],
                palette=ListedColormap([PALETTE[k % len(PALETTE)] for k in range(len(entries))]))
    return Sheet([view], [""], 1, [Scale(view, "which code solves what", list(map(code_label, entries)))], ["not deformed"])


_MOST_STEPS, _MOST_FACES = 3, 9  # load steps and interfaces that are drawn, status beside pressure; of more steps, evenly many


def interfaces(fields: Fields, look: Look = Look(), imposed: bool = False) -> Sheet | None:
    """Status and pressure of the interfaces, laid flat, at each load step; None where there are none.

    Those whose jump is imposed, whatever force it takes, have another scale, and tension: of them and of the others only one kind
    is drawn, unless there is no other. Of many, those that carry most. A node's status fills its share of the triangles. Where all
    of a triangle's nodes are open, pressure is grey.

    imposed : whether those are meant; then there must be others too
    """
    from matplotlib.colors import ListedColormap

    every = _chosen(fields.interfaces, imposed)
    if every is None:
        return None
    unit, force = look.units["stress"], np.add.reduceat(np.abs(every.pressure) * every.areas, every.offsets[:-1], axis=1).max(axis=0)
    first = np.argsort(-force, kind="stable")[:_MOST_FACES]  # those that never carry anything only where none does
    i = every.some(np.sort(first[force[first] > EQUAL * force.max()] if force.any() else first))
    steps = look.of_steps(fields.steps) or spread(fields.steps, _MOST_STEPS, int((np.abs(i.pressure) * i.areas).sum(axis=1).argmax()))
    flat = laid_flat(fields.nodes, i, look.units["length"])
    camera = Camera.framing(flat.frame, np.array([0.0, 0.0, 1.0]), 0.01)
    shared = {"camera": camera, "lines": flat.rims, "shaded": False}
    # at corners of triangles, nan where open
    parted = np.isin(i.status, i.kinds[i.kind_names == COUNTED[0]])[steps][:, i.triangles].all(axis=2)
    pressure = np.where(parted[:, :, None], np.nan, (-i.pressure if imposed else i.pressure)[steps][:, i.triangles])
    area = np.bincount(i.triangles.ravel(), np.ones(i.triangles.size), minlength=len(i.nodes))  # a node counts once
    weight = (i.area / np.maximum(area, 1.0))[i.triangles]
    (low, high), extremes = colour_limits(pressure.ravel(), np.tile(weight.ravel(), len(steps)))
    name, ends = "tension" if imposed else "pressure", (min(low, 0.0), max(high, 0.0))
    pieces, corners = shares(flat.corners).reshape(-1, 3), flat.corners.reshape(-1, 3)
    pushed = [View(corners, np.arange(len(corners)).reshape(-1, 3), values.ravel(), limits=ends, extremes=extremes, palette=viridis(),
                   names=flat.names * (k == 0), **shared) for k, values in enumerate(pressure)]
    count, most = len(every.names), np.linalg.norm(every.friction_traction, axis=2).max(initial=0.0)
    most = most if most > EQUAL * np.abs(every.pressure).max(initial=0.0) else 0.0  # what rounding leaves beside the pressure is none
    told = [f"{count} interface{'s' * (count != 1)}" + " whose jump is imposed" * imposed,
            *[f"drawn: the {len(i.names)} that carry most"] * (count > len(i.names)),
            f"largest {name} {short(float((-every.pressure if imposed else every.pressure).max()))}{unit}",
            f"largest tangential traction {short(most)}{unit}",
            *["grey: open"] * bool(np.isnan(pressure).any()), *omitted(fields, steps)]
    scale = Scale(pushed[0], name + (unit and "," + unit))
    if imposed:  # tightened, then locked: nothing to see
        return Sheet(pushed, headings(fields, steps), min(len(steps), 2), [scale], told)
    present = np.flatnonzero(np.isin(i.kinds, i.status[steps]))
    palette = ListedColormap(i.kind_colours[present].tolist())
    kind = np.searchsorted(i.kinds[present], i.status[steps])[:, i.triangles].reshape(len(steps), -1).astype(float)
    held = [View(pieces, np.arange(len(pieces)).reshape(-1, 3), np.repeat(status, 6), limits=(-0.5, palette.N - 0.5), palette=palette,
                 **shared) for status in kind]
    return Sheet([view for both in zip(held, pushed) for view in both], [text for text in headings(fields, steps) for _ in range(2)], 2,
                 [Scale(held[0], "status", i.kind_names[present].tolist()), scale], told)


def _chosen(i: InterfaceFields | None, imposed: bool) -> InterfaceFields | None:
    if i is None:
        return None
    given = np.array([law in LAWS and LAWS[law].as_one for law in i.laws])
    if given.any() and not given.all():
        return i.some(np.flatnonzero(given == imposed))
    return None if imposed else i
