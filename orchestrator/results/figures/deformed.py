"""The deformed structure: deformed.png with von Mises stress, codes.png coloured by the code that solves each part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.sheet import Scale, Sheet
from orchestrator.results.figures.surface import Skin, drawn_cells, skin
from orchestrator.results.figures.view import Camera, Look, View, colour_limits, toward_eye
from orchestrator.results.summary.words import code_label
from orchestrator.scene.mesh.geometry import area_vectors

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
