"""The visible surface of a mesh: its outer faces, edges worth a line, what a cut shows, and the stresses there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.results.fields.fields import Fields
from orchestrator.results.figures.view import Look, NO_LINES
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of

SHARP = 30.0  # degrees by which neighbouring faces turn


def grid_of(nodes: np.ndarray, cells: np.ndarray):
    """pyvista's grid of nodes (n, 3) and cells (m, 4 or 10)."""
    import pyvista

    kind = {4: pyvista.CellType.TETRA, 10: pyvista.CellType.QUADRATIC_TETRA}[cells.shape[1]]
    return pyvista.UnstructuredGrid({kind: np.asarray(cells, dtype=np.int64)}, np.asarray(nodes, dtype=float))


def outer_faces(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces that belong to one tet only; those of a ten-node tet in four triangles each.

    nodes : (n, 3); cells : (m, 4 or 10) int, VTK's order
    Returns triangles : (k, 3) node ids, oriented outward; cell : (k,) the tet of each
    """
    grid = grid_of(nodes, cells)
    grid.point_data["node"], grid.cell_data["cell"] = np.arange(len(nodes)), np.arange(len(cells))
    # pyvista's own numbers of points and cells are not those of the grid where faces are divided
    found = grid.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=1, pass_pointid=False, pass_cellid=False)
    return np.asarray(found["node"])[found.regular_faces], np.array(found["cell"])


def edges(nodes: np.ndarray, triangles: np.ndarray, part: np.ndarray | None = None, sharp: float = SHARP) -> np.ndarray:
    """(e, 2) node ids of the edges where faces turn sharply, at borders between parts, and of open rims.

    nodes : (n, 3); triangles : (k, 3) int
    part : (k,) int, of each triangle; none: they are one
    sharp : degrees; 180 for rims and borders only
    """
    ends, edge = edges_of(triangles, TRIANGLE_EDGES)
    owner, key = np.repeat(np.arange(len(triangles)), 3), edge.ravel()
    label = np.zeros(len(key), dtype=int) if part is None else np.asarray(part, dtype=int)[owner]
    order = np.lexsort((label, key))
    key, label, owner = key[order], label[order], owner[order]
    normal = area_vectors(nodes, triangles)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    inner = key[1:] == key[:-1]  # a triangle and the next one share the edge
    smooth = inner & (label[1:] == label[:-1]) & (np.einsum("ij,ij->i", normal[owner[1:]], normal[owner[:-1]]) >= np.cos(np.radians(sharp)))
    shared = np.r_[False, smooth] | np.r_[smooth, False]
    return ends[np.unique(key[~shared])]


def box_edges(points: np.ndarray) -> np.ndarray:
    """(12, 2, 3) edges of the bounding box: an outline for bodies without sharp edges."""
    corner = np.indices((2, 2, 2)).reshape(3, 8).T
    one, other = np.nonzero(np.triu(np.abs(corner[:, None] - corner).sum(axis=2) == 1))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.where(corner[np.column_stack([one, other])], high, low)


@dataclass(frozen=True)
class Skin:
    """Triangles on points of their own, at some load steps.

    points : (p, 3) undeformed; triangles : (k, 3) int; lines : (e, 2) int, edges worth a line
    cell : (k,) int, the tet behind each triangle
    displacement : step → (p, 3); stress : step → (p,) von Mises stress, nan where it is not known
    peaks : step → (2, 3) place and displacement of the largest stress in what is drawn, and its value; None: not known
    outline : (o, 2, 3) sharp edges of the whole undeformed structure, or its box; none where it is cut or parts are drawn
    """

    points: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    cell: np.ndarray
    displacement: dict[int, np.ndarray]
    stress: dict[int, np.ndarray]
    peaks: dict[int, tuple[np.ndarray, float] | None]
    outline: np.ndarray


def drawn_cells(fields: Fields, look: Look) -> np.ndarray:
    """(k,) int, tets that are drawn; none of those that stand for parts whose mesh is another program's."""
    kept = look.chosen(fields.parts, fields.part, len(fields.cells))
    return kept[fields.lame[kept, 1] > 0]


def skin(fields: Fields, steps: Sequence[int], look: Look, toward: np.ndarray) -> Skin:
    """The surface of a solution, to be drawn; ``toward``: (3,) from the structure to the eye: what a cut takes away is there."""
    drawn, (node, cells), kept = fields.opened, fields.nodal.split, drawn_cells(fields, look)
    stress = {step: fields.nodal.von_mises(step) for step in steps}
    places = np.unique(cells[kept])  # those with a stress in what is drawn
    if look.cut is not None:
        axis, at = look.cut
        behind = (drawn.nodes[node[places], axis] <= at) == (toward[axis] >= 0)
        places = places[behind] if behind.any() else places
        points, triangles, cell, arrays = _cut(fields, cells[kept], kept, steps, stress, look.cut, toward)
        outline, lines = NO_LINES, _lines_of_cut(fields, points, triangles, cell, look.cut)
    else:
        faces, cell = outer_faces(drawn.nodes, drawn.cells[kept])
        cell = kept[cell]
        local = (drawn.cells[cell][:, None] == faces[:, :, None]).argmax(axis=2)  # which of its tet's nodes a corner is
        used, triangles = np.unique(cells[cell[:, None], local], return_inverse=True)
        triangles, points = triangles.reshape(-1, 3), drawn.nodes[node[used]]
        arrays = {step: (drawn.displacement[step][node[used]], stress[step][used]) for step in steps}
        place = np.zeros(len(drawn.nodes), dtype=int)
        place[node[used][::-1]] = np.arange(len(used))[::-1]
        lines = place[edges(drawn.nodes, faces, fields.subdomain[cell])]
        outline = NO_LINES
        if not look.parts:
            sharp = edges(fields.nodes, outer_faces(fields.nodes, fields.cells[fields.lame[:, 1] > 0])[0])
            outline = fields.nodes[sharp] if len(sharp) else box_edges(fields.nodes)
    peaks = {step: _peak(drawn, node[places], step, values[places]) for step, values in stress.items()}
    return Skin(points, triangles, lines, cell, *({step: found[k] for step, found in arrays.items()} for k in (0, 1)), peaks, outline)


def _peak(drawn: Fields, nodes: np.ndarray, step: int, values: np.ndarray) -> tuple[np.ndarray, float] | None:
    if not np.isfinite(values).any():
        return None
    most = int(np.nanargmax(values))
    return np.stack([drawn.nodes[nodes[most]], drawn.displacement[step][nodes[most]]]), float(values[most])


def _cut(fields: Fields, cells: np.ndarray, kept: np.ndarray, steps: Sequence[int], stress: Mapping[int, np.ndarray],
         plane: tuple[int, float], toward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[int, tuple]]:
    """Points, triangles, tets behind them, and per step displacement and stress: what is linear on clipped tets stays so."""
    drawn, (axis, at) = fields.opened, plane
    used, corners = np.unique(cells[:, :4], return_inverse=True)
    at_used = fields.nodal.split[0][used]
    grid = grid_of(drawn.nodes[at_used], corners.reshape(-1, 4))
    for step in steps:
        grid.point_data[f"u{step}"], grid.point_data[f"s{step}"] = drawn.displacement[step][at_used], stress[step][used]
    grid.cell_data["tet"] = kept
    normal, origin = np.zeros(3), np.zeros(3)
    normal[axis], origin[axis] = 1.0 if toward[axis] >= 0 else -1.0, at
    left = grid.clip(normal=normal, origin=origin)  # keeps what the normal looks away from
    seen = (left if left.n_cells else grid).extract_surface(algorithm="dataset_surface", pass_pointid=False, pass_cellid=False)
    seen = seen.triangulate()
    points, triangles, cell = np.asarray(seen.points, float), np.array(seen.regular_faces), np.asarray(seen["tet"])
    outward = points[triangles].mean(axis=1) - drawn.nodes[drawn.cells[cell, :4]].mean(axis=1)
    inward = np.einsum("ij,ij->i", area_vectors(points, triangles), outward) < 0
    triangles[inward] = triangles[inward, ::-1]  # what a clip leaves of tets is turned either way
    return points, triangles, cell, {
        step: (np.asarray(seen[f"u{step}"]), np.asarray(seen[f"s{step}"])) for step in steps}


def _lines_of_cut(fields: Fields, points: np.ndarray, triangles: np.ndarray, cell: np.ndarray, plane: tuple[int, float]) -> np.ndarray:
    """Points that are one but for rounding are one; slivers of the cut have no normals to speak of and count for nothing."""
    axis, at = plane
    grain = 1e-6 * np.ptp(fields.nodes, axis=0).max()
    first, same = np.unique(np.rint(points / grain), axis=0, return_index=True, return_inverse=True)[1:]
    merged = first[same.ravel()[triangles]]
    whole = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    flat = (np.abs(points[triangles, axis] - at) <= grain).all(axis=1)
    return np.concatenate([edges(points, merged[some], fields.subdomain[cell[some]], sharp)
                           for some, sharp in ((whole & ~flat, SHARP), (whole & flat, 180.0))])
