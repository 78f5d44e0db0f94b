"""What is seen of a structure: its outer faces, or those of what a cut leaves, with what is drawn on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures import surface
from orchestrator.results.figures.look import Look


@dataclass(frozen=True)
class Skin:
    """Triangles on points of their own, at some load steps.

    Parameters
    ----------
    points : (p, 3) undeformed; triangles : (k, 3) int; lines : (e, 2) int, edges worth a line
    cell : (k,) int, the tet behind each triangle
    displacement : step → (p, 3); stress : step → (p,) von Mises stress, nan where it is not known
    peaks : step → (2, 3) place and displacement of the largest stress in what is drawn, and its value; None: not known
    """

    points: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    cell: np.ndarray
    displacement: dict[int, np.ndarray]
    stress: dict[int, np.ndarray]
    peaks: dict[int, tuple[np.ndarray, float] | None]


@dataclass(frozen=True)
class Shape:
    """What is seen of an undeformed structure, where nothing is cut.

    Parameters
    ----------
    kept : (k,) int, the tets that are drawn
    own : (p,) int, the places with a stress in them, see ``Nodal.split``
    used : (q,) int, those on the surface
    triangles : (t, 3) int, indices into ``used``; cell : (t,) int, the tet behind each
    lines : (e, 2) int, indices into ``used``: edges worth a line
    outline : (o, 2, 3) sharp edges of the whole structure, or its box; none where parts of it are drawn
    """

    kept: np.ndarray
    own: np.ndarray
    used: np.ndarray
    triangles: np.ndarray
    cell: np.ndarray
    lines: np.ndarray
    outline: np.ndarray


def shape(fields: Fields, look: Look) -> Shape:
    """Of a solution or of what will become one: its displacements play no part."""
    drawn, (node, cells) = fields.opened, fields.nodal.split
    kept = _kept(fields, look)
    faces, cell = surface.outer_faces(drawn.nodes, drawn.cells[kept])
    cell = kept[cell]
    lines = surface.edges(drawn.nodes, faces, fields.subdomain[cell])
    local = (drawn.cells[cell][:, None] == faces[:, :, None]).argmax(axis=2)  # which of its tet's nodes a corner is
    used, triangles = np.unique(cells[cell[:, None], local], return_inverse=True)
    place = np.zeros(len(drawn.nodes), dtype=int)
    place[node[used][::-1]] = np.arange(len(used))[::-1]
    return Shape(kept, np.unique(cells[kept]), used, triangles.reshape(-1, 3), cell, place[lines],
                 np.empty((0, 2, 3)) if look.parts else _outline(fields))


def anything(fields: Fields, look: Look) -> bool:
    """Whether there is a tet to be drawn: of parts whose mesh is another program's there is none."""
    return len(_kept(fields, look)) > 0


def _kept(fields: Fields, look: Look) -> np.ndarray:
    """(k,) int, tets that are drawn."""
    kept = look.chosen(fields.parts, fields.part, len(fields.cells))
    return kept[fields.lame[kept, 1] > 0]  # others stand for parts whose mesh is another program's


def _outline(fields: Fields) -> np.ndarray:
    """(e, 2, 3) sharp edges of the undeformed structure, or its box."""
    whole = surface.outer_faces(fields.nodes, fields.cells[fields.lame[:, 1] > 0])[0]
    sharp = surface.edges(fields.nodes, whole)
    return fields.nodes[sharp] if len(sharp) else surface.box_edges(fields.nodes)


def skin(fields: Fields, steps: Sequence[int], look: Look, toward: np.ndarray, seen: Shape | None = None,
         known: Mapping[int, np.ndarray] | None = None) -> Skin:
    """What is drawn of a solution.

    Parameters
    ----------
    toward : (3,) from the structure to the eye: what a cut takes away is there
    seen : ``shape`` of these fields; None: found here
    known : step → ``Nodal.von_mises``; None: computed here
    """
    drawn, nodal = fields.opened, fields.nodal
    node, cells = nodal.split
    stress = {step: nodal.von_mises(step) for step in steps} if known is None else known
    if look.cut is None:
        seen = seen or shape(fields, look)
        kept, own = seen.kept, seen.own
    else:
        kept = _kept(fields, look)
        own = np.unique(cells[kept])
        front = toward[look.cut[0]] >= 0
        behind = (drawn.nodes[node[own], look.cut[0]] <= look.cut[1]) == front
        own = own[behind] if behind.any() else own
    peaks = {step: _peak(drawn, node[own], step, values[own]) for step, values in stress.items()}
    if look.cut is not None:
        return _cut(fields, node, cells, kept, steps, stress, peaks, look.cut, toward)
    at = node[seen.used]
    return Skin(drawn.nodes[at], seen.triangles, seen.lines, seen.cell, {step: drawn.displacement[step][at] for step in steps},
                {step: values[seen.used] for step, values in stress.items()}, peaks)


def _peak(drawn: Fields, nodes: np.ndarray, step: int, values: np.ndarray) -> tuple[np.ndarray, float] | None:
    if not np.isfinite(values).any():
        return None
    most = int(np.nanargmax(values))
    return np.stack([drawn.nodes[nodes[most]], drawn.displacement[step][nodes[most]]]), float(values[most])


def _cut(fields: Fields, node: np.ndarray, cells: np.ndarray, kept: np.ndarray, steps: Sequence[int],
         stress: dict[int, np.ndarray], peaks: dict, plane: tuple[int, float], toward: np.ndarray) -> Skin:
    """By VTK, through pyvista: tets are clipped, what is linear on them stays so."""
    import pyvista

    drawn, (axis, at) = fields.opened, plane
    used, corners = np.unique(cells[kept][:, :4], return_inverse=True)
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: corners.reshape(-1, 4)}, drawn.nodes[node[used]])
    for step in steps:
        grid.point_data[f"u{step}"], grid.point_data[f"s{step}"] = drawn.displacement[step][node[used]], stress[step][used]
    grid.cell_data["tet"] = kept
    normal, origin = np.zeros(3), np.zeros(3)
    normal[axis], origin[axis] = 1.0 if toward[axis] >= 0 else -1.0, at
    whole = grid.clip(normal=normal, origin=origin)  # keeps what the normal looks away from
    if not whole.n_cells:
        whole = grid
    seen = whole.extract_surface(algorithm="dataset_surface", pass_pointid=False, pass_cellid=False).triangulate()
    triangles, points, cell = seen.regular_faces, np.asarray(seen.points, float), np.asarray(seen["tet"])
    # for lines points that are one but for rounding are one, and slivers of the cut, which have no normals to speak of, none
    grain = 1e-6 * np.ptp(fields.nodes, axis=0).max()
    first, same = np.unique(np.rint(points / grain), axis=0, return_index=True, return_inverse=True)[1:]
    merged = first[same.ravel()[triangles]]
    whole_ones = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    flat = (np.abs(points[triangles, axis] - at) <= grain).all(axis=1)
    lines = np.concatenate([
        surface.edges(points, merged[some], fields.subdomain[cell[some]], sharp)
        for some, sharp in ((whole_ones & ~flat, surface.SHARP), (whole_ones & flat, 180.0)) if some.any()])
    return Skin(points, triangles, lines, cell,
                {step: np.asarray(seen[f"u{step}"]) for step in steps}, {step: np.asarray(seen[f"s{step}"]) for step in steps}, peaks)
