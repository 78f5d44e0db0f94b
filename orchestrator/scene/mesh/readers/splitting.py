"""Hexahedra, prisms and pyramids split into tets, quads into triangles, such that neighbours'
diagonals agree.

The pulling triangulation (De Loera, Rambau & Santos, Triangulations, 2010, 4.3.2; Dompierre, Labbé,
Vallet & Camarero, How to subdivide pyramids, prisms and hexahedra into tetrahedra, 1999): with all
nodes of the mesh in one order, the diagonal of every quad starts at its first node, and the tets of
a cell join its first node to the triangles of the faces that lack it. A hexahedron gives six, a
prism three, a pyramid two. The order is that of the coordinates, not of the numbers: a renumbered
mesh is split the same way, and so are bodies that touch node to node without sharing nodes.

Of quadratic cells the corners are kept before, and edges that bend become straight.
"""

from __future__ import annotations

import meshio
import numpy as np

from orchestrator.linalg import WRITTEN
from orchestrator.scene.mesh.checks import bad_file
from orchestrator.scene.mesh.faces import LOCAL_FACES, pack
from orchestrator.scene.mesh.geometry import format_point, position_rank, tet_volumes
from orchestrator.scene.mesh.quadratic import TET_EDGES

# Cells with nodes amid their edges: the linear ones that they are read as, and their corners.
CORNERS = {"tetra10": ("tetra", 4), "triangle6": ("triangle", 3), "quad8": ("quad", 4),
           "quad9": ("quad", 4),
           "hexahedron20": ("hexahedron", 8), "hexahedron27": ("hexahedron", 8),
           "wedge15": ("wedge", 6), "wedge18": ("wedge", 6),
           "pyramid13": ("pyramid", 5), "pyramid14": ("pyramid", 5)}
# Ends of the edges behind the nodes that follow the corners, in VTK's order, which is meshio's and
# CalculiX's.
_RING = [[0, 1], [1, 2], [2, 3], [3, 0]]
_HEX = np.array([*_RING, [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_WEDGE = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])
_PYRAMID = np.array([*_RING, [0, 4], [1, 4], [2, 4], [3, 4]])
EDGES = {"tetra10": TET_EDGES, "hexahedron20": _HEX, "hexahedron27": _HEX, "wedge15": _WEDGE,
         "wedge18": _WEDGE,
         "pyramid13": _PYRAMID, "pyramid14": _PYRAMID}


def straightened(raw: meshio.Mesh) -> tuple[meshio.Mesh, list[str]]:
    """The mesh with linear cells in the place of quadratic ones, and what to say of it."""
    if not any(block.type in CORNERS for block in raw.cells):
        return raw, []
    said = [
        "ten-node tetrahedra are read by their corners; blackbox: {element: P2} puts a node on "
        "the middle of every edge"]
    if not any(block.type == "tetra10" for block in raw.cells):
        said = [said[0].replace("ten-node tetrahedra", "quadratic cells")]
    worst, off = 0.0, 0.0
    for block in (block for block in raw.cells if block.type in EDGES):
        ends, first = raw.points[block.data[:, EDGES[block.type]]], CORNERS[block.type][1]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        bend = np.linalg.norm(raw.points[block.data[:, first : first + ends.shape[1]]]
                              - ends.mean(axis=2), axis=2)
        if (bend > WRITTEN * length).any():
            worst, off = max(worst, float(np.max(bend / length))), max(off, float(bend.max()))
    if worst:
        said.append(
            f"edges that bend are straight here: their middles are off by up to {off:.3g}, or "
            f"{worst:.2g} of an edge; a finer mesh follows the shape better")
    cells = [meshio.CellBlock(CORNERS[b.type][0], b.data[:, : CORNERS[b.type][1]])
             if b.type in CORNERS else b for b in raw.cells]
    return meshio.Mesh(raw.points, cells, cell_data=raw.cell_data, cell_sets=raw.cell_sets,
                       field_data=raw.field_data), said


# Faces of each shape in VTK's order of nodes, anticlockwise seen from outside.
FACES = {
    "hexahedron": [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6],
                   [3, 0, 4, 7]],
    "wedge": [[0, 2, 1], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
    "pyramid": [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
}
# Those of tets too, in the order in which CalculiX and Abaqus call them S1, S2, …
SIDES = {"tetra": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], **FACES}
WORDS = {"hexahedron": "hexahedra", "wedge": "prisms", "pyramid": "pyramids"}


def in_tets(raw: meshio.Mesh, source: str) -> tuple[meshio.Mesh, list[str]]:
    """The mesh with tets and triangles alone in the place of linear cells of other shapes, and what
    to say of it.

    Cell data and cell sets go with the pieces. Tets of hexahedra that have fewer corners (nodes
    that are given twice) and would be nothing are left out.

    Raises InputError: cells that are too distorted to be split, with the place of the first; a quad
        that tets beside it cut along its other diagonal
    """
    kinds = {block.type for block in raw.cells}
    if not kinds & {*FACES, "quad"}:
        return raw, []
    order = position_rank(np.asarray(raw.points, dtype=float))
    blocks, parents, quads, said = [], [], [], []
    for block in raw.cells:
        cells, kind = np.asarray(block.data, dtype=np.int64), block.type
        pieces, parent = cells, np.arange(len(cells))
        if kind == "quad":
            pieces, parent = _from_first(cells, order)[:,
                                                       [[0, 1, 2], [0, 2, 3]]].reshape(
                                                           -1, 3), np.repeat(parent, 2)
            # of a quad with three corners one is a triangle
            whole = (pieces != np.roll(pieces, 1, axis=1)).all(axis=1)
            pieces, parent, kind = pieces[whole], parent[whole], "triangle"
        elif kind in FACES:
            pieces, parent = _turned(raw.points, *_tets(cells, kind, order), cells, kind, source)
            quads += [cells[:, face] for face in FACES[kind] if len(face) == 4]
            kind = "tetra"
        blocks.append(meshio.CellBlock(kind, pieces))
        parents.append(parent)
    counts = {kind: sum(len(b.data) for b in raw.cells if b.type == kind) for kind in FACES}
    if any(counts.values()):
        if "tetra" in kinds:
            _check_diagonals(raw, np.vstack(quads), order, source)
        pieces = sum(len(piece.data) for piece, block in zip(blocks, raw.cells)
                     if block.type in FACES)
        said.append(" and ".join(f"{count:,} {WORDS[kind]}" for kind, count in counts.items()
                                 if count)
                    + f" are split into {pieces:,} tetrahedra; blackbox: {{element: P2}} makes "
                    "these far less stiff in bending")
    data = {name: [np.asarray(values)[parent] for values, parent in zip(arrays, parents)]
            for name, arrays in raw.cell_data.items()}
    sets = {
        name: [None if members is None
               else np.flatnonzero(np.isin(parent, np.asarray(members, dtype=np.int64)))
               for members, parent in zip(arrays, parents)]
        for name, arrays in raw.cell_sets.items() if not name.startswith("gmsh:")}
    return meshio.Mesh(raw.points, blocks, cell_data=data, cell_sets=sets,
                       field_data=raw.field_data), said


def _from_first(face: np.ndarray, order: np.ndarray) -> np.ndarray:
    """The nodes (k, 3 or 4) of faces in the same sense of rotation, each from its first node on."""
    width = face.shape[1]
    return np.take_along_axis(face,
                              (order[face].argmin(axis=1)[:, None] + np.arange(width)) % width,
                              axis=1)


def _tets(cells: np.ndarray, kind: str, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tets (t, 4) of cells, ordered by the cell (t,) of each."""
    first = np.take_along_axis(cells, order[cells].argmin(axis=1)[:, None], axis=1)[:, 0]
    tets, parents = [], []
    for face in FACES[kind]:
        rolled = _from_first(cells[:, face], order)
        # where it has it, it is the first of the face too
        lacks = np.flatnonzero(rolled[:, 0] != first)
        for i in range(len(face) - 2):
            tets.append(np.column_stack([first, rolled[:, [0, i + 1, i + 2]]])[lacks])
            parents.append(lacks)
    tets, parent = np.concatenate(tets), np.concatenate(parents)
    ascending = np.sort(tets, axis=1)
    whole = (ascending[:, 1:] != ascending[:, :-1]).all(axis=1)
    tets, parent = tets[whole], parent[whole]
    by_cell = np.argsort(parent, kind="stable")
    return tets[by_cell], parent[by_cell]


def _turned(points: np.ndarray, tets: np.ndarray, parent: np.ndarray, cells: np.ndarray, kind: str,
            source: str) -> tuple[np.ndarray, np.ndarray]:
    """The tets, positive all; a block whose cells are all inside out follows another convention."""
    volumes = tet_volumes(points, tets)
    if len(volumes) and volumes.max() < 0:
        return tets[:, [0, 2, 1, 3]], parent
    if len(bad := np.unique(parent[volumes <= 0])):
        raise bad_file(source,
                       f"{len(bad)} of {len(cells)} {WORDS[kind]} are too distorted to be split "
                       "into tetrahedra; the first is around "
                       f"{format_point(points[cells[bad[0]]].mean(axis=0))}",
                       "convex cells, all oriented the same way",
                       "mesh the volume with tetrahedra, or make these cells rounder (gmsh: "
                       "Mesh.RecombineAll = 0)")
    return tets, parent


def _check_diagonals(raw: meshio.Mesh, quads: np.ndarray, order: np.ndarray, source: str) -> None:
    """Raises where tets of the file cut a quad of another cell along the diagonal that is not ours:
    a crack nobody sees.
    """
    tets = np.vstack([block.data for block in raw.cells if block.type == "tetra"])
    # Quads that are given from both sides begin with the same node and turn the other way.
    rolled = np.unique(_from_first(quads, order), axis=0)
    used = np.unique(np.concatenate([tets.ravel(), rolled.ravel()]))
    faces, other = (np.searchsorted(used, t)
                    for t in (tets[:, LOCAL_FACES].reshape(-1, 3), rolled[:, [0, 1, 3]]))
    wrong = np.flatnonzero(np.isin(pack(other, len(used)), pack(faces, len(used))))
    if len(wrong):
        raise bad_file(source,
                       f"{len(wrong)} quads of hexahedra, prisms or pyramids have tetrahedra on "
                       "their other side that cut them along the other diagonal; the first is "
                       f"around {format_point(raw.points[rolled[wrong[0]]].mean(axis=0))}",
                       "pyramids between hexahedra and tetrahedra",
                       "mesh the volume with tetrahedra alone, or let the program put pyramids "
                       "between them")
