"""Quadratic cells of mesh files as linear ones: their corners are kept, and edges that bend become straight."""

from __future__ import annotations

import meshio
import numpy as np

from orchestrator.scene.mesh.quadratic import TET_EDGES

# Cells with nodes amid their edges: the linear ones that they are read as, and their corners.
CORNERS = {"tetra10": ("tetra", 4), "triangle6": ("triangle", 3), "quad8": ("quad", 4), "quad9": ("quad", 4),
           "hexahedron20": ("hexahedron", 8), "hexahedron27": ("hexahedron", 8), "wedge15": ("wedge", 6), "wedge18": ("wedge", 6),
           "pyramid13": ("pyramid", 5), "pyramid14": ("pyramid", 5)}
# Ends of the edges behind the nodes that follow the corners, in VTK's order, which is meshio's and CalculiX's.
_RING = [[0, 1], [1, 2], [2, 3], [3, 0]]
_HEX = np.array([*_RING, [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_WEDGE = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])
_PYRAMID = np.array([*_RING, [0, 4], [1, 4], [2, 4], [3, 4]])
EDGES = {"tetra10": TET_EDGES, "hexahedron20": _HEX, "hexahedron27": _HEX, "wedge15": _WEDGE, "wedge18": _WEDGE,
         "pyramid13": _PYRAMID, "pyramid14": _PYRAMID}
BENT = 1e-6  # of an edge's length, from which its middle is not where a straight one's would be


def straightened(raw: meshio.Mesh) -> tuple[meshio.Mesh, list[str]]:
    """The mesh with linear cells in the place of quadratic ones, and what to say of it."""
    if not any(block.type in CORNERS for block in raw.cells):
        return raw, []
    said = ["ten-node tetrahedra are read by their corners; blackbox: {element: P2} puts a node on the middle of every edge"]
    if not any(block.type == "tetra10" for block in raw.cells):
        said = [said[0].replace("ten-node tetrahedra", "quadratic cells")]
    worst, off = 0.0, 0.0
    for block in raw.cells:
        if block.type not in EDGES:
            continue
        ends = raw.points[block.data[:, EDGES[block.type]]]
        first = CORNERS[block.type][1]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        bend = np.linalg.norm(raw.points[block.data[:, first : first + ends.shape[1]]] - ends.mean(axis=2), axis=2)
        if (bend > BENT * length).any():
            worst = max(worst, float(np.max(bend / length)))
            off = max(off, float(bend.max()))
    if worst:
        said.append(f"edges that bend are straight here: their middles are off by up to {off:.3g}, or {worst:.2g} of an edge; "
                    "a finer mesh follows the shape better")
    cells = [meshio.CellBlock(CORNERS[b.type][0], b.data[:, : CORNERS[b.type][1]]) if b.type in CORNERS else b for b in raw.cells]
    return meshio.Mesh(raw.points, cells, cell_data=raw.cell_data, cell_sets=raw.cell_sets, field_data=raw.field_data), said
