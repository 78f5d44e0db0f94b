"""What one sees of a mesh: its outer faces, and the edges worth a line."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors

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
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    key = pairs[:, 0] * np.int64(len(nodes)) + pairs[:, 1]
    label = np.zeros(len(key), dtype=int) if part is None else np.asarray(part, dtype=int)[owner]
    order = np.lexsort((label, key))
    key, label, owner, pairs = key[order], label[order], owner[order], pairs[order]
    normal = area_vectors(nodes, triangles)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    inner = key[1:] == key[:-1]  # a triangle and the next one share the edge
    smooth = inner & (label[1:] == label[:-1]) & (
        np.einsum("ij,ij->i", normal[owner[1:]], normal[owner[:-1]]) >= np.cos(np.radians(sharp)))
    shared = np.r_[False, smooth] | np.r_[smooth, False]
    return np.unique(pairs[~shared], axis=0)


def box_edges(points: np.ndarray) -> np.ndarray:
    """(12, 2, 3) edges of the bounding box: an outline for bodies without sharp edges."""
    corner = np.indices((2, 2, 2)).reshape(3, 8).T
    one, other = np.nonzero(np.triu(np.abs(corner[:, None] - corner).sum(axis=2) == 1))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.where(corner[np.column_stack([one, other])], high, low)
