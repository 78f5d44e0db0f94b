"""Ten-node tets: one node in the middle of every edge of a mesh of four-node tets.

Edges stay straight, so that the geometry, volumes, areas and normals are those of the corners,
which keep their numbers and come first: in a tet's ten nodes, in a face's six, and in the mesh. The
order within an element is VTK's.

On the same mesh ten-node tets cost several times as much and are better by more than that: their
error falls with h² where the solution is smooth, that of four-node tets with h, which are too stiff
in bending and lock as ν goes to ½. So ``element: auto`` takes them, unless there is a reason not
to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh

# Ends of the edges behind nodes 4 … 9 of a tet, and behind nodes 3 … 5 of a triangle.
TET_EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])
QUARTERS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])  # of a triangle of six nodes

# Integrals of the shape functions over an element, as shares of its volume or area, by number of
# nodes.
TET_SHARES = {4: np.full(4, 1 / 4), 10: np.r_[np.full(4, -1 / 20), np.full(6, 1 / 5)]}
# Of shape functions times barycentric coordinates, ∫ φ_a λ_b.
_IS_END = (TET_EDGES[:, :, None] == np.arange(4)).any(axis=1)
TET_MOMENTS = {4: (1 + np.eye(4)) / 20, 10: np.vstack([(np.eye(4) - 1) / 60, (1 + _IS_END) / 30])}
_IS_END = (TRIANGLE_EDGES[:, :, None] == np.arange(3)).any(axis=1)
TRIANGLE_MOMENTS = {3: (1 + np.eye(3)) / 12,
                    6: np.vstack([(3 * np.eye(3) - 1) / 60, (1 + _IS_END) / 15])}
# Integrates polynomials of degree 4 over a triangle (Strang & Fix 1973): weights, barycentric
# coordinates.
_A, _B = 0.445948490915965, 0.091576213509771
DEGREE_4 = (np.repeat([0.223381589678011, 0.109951743655322], 3),
            np.concatenate([np.full((3, 3), x) + (1 - 3 * x) * np.eye(3) for x in (_A, _B)]))
# Points, in barycentric coordinates, of rules of equal weights over a tet: exact for linear
# functions, and for quadratic ones.
_A = (5 - np.sqrt(5)) / 20
TET_POINTS = {4: np.full((1, 4), 0.25), 10: np.full((4, 4), _A) + (1 - 4 * _A) * np.eye(4)}
TRIANGLE_SHARES = {3: np.full(3, 1 / 3), 6: np.r_[np.zeros(3), np.full(3, 1 / 3)]}
# Where laws act at all six nodes: a mass matrix scaled to its diagonal. And of the linear functions
# of the corners.
LUMPED_SHARES = {3: np.full(3, 1 / 3), 6: np.r_[np.full(3, 1 / 12), np.full(3, 1 / 4)]}
CORNER_SHARES = {3: np.full(3, 1 / 3), 6: np.r_[np.full(3, 1 / 3), np.zeros(3)]}


def quadratic(mesh: Mesh, faces: Faces) -> tuple[Mesh, Faces]:
    """The mesh with ten-node tets (m, 10), and its faces with six nodes (f, 6)."""
    n = len(mesh.nodes)
    ends, edge = edges_of(mesh.cells, TET_EDGES)
    nodes = np.vstack([mesh.nodes, mesh.nodes[ends].mean(axis=1)])
    triangles = np.hstack([faces.triangles, n + find(ends, faces.triangles[:, TRIANGLE_EDGES])])
    return (replace(mesh, nodes=nodes, cells=np.hstack([mesh.cells, n + edge])),
            replace(faces, triangles=triangles))


def faces_of_six(faces: Faces, cells: np.ndarray) -> Faces:
    """Faces (f, 3) of ten-node tets (m, 10) with the nodes in the middle of their edges."""
    ends, edge = edges_of(cells[:, :4], TET_EDGES)
    middle = np.empty(len(ends), dtype=int)
    middle[edge] = cells[:, 4:]
    return replace(faces,
                   triangles=np.hstack([faces.triangles,
                                        middle[find(ends, faces.triangles[:, TRIANGLE_EDGES])]]))


def edges_of(elements: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges of elements (m, p), each once: ends (e, 2) int, ascending within and among rows,
    and edge (m, q) int, index into ends.

    local : (q, 2) int, ends of an element's edges in its own numbering
    """
    pairs = np.sort(elements[:, local], axis=2).reshape(-1, 2).astype(np.int64)
    size = int(pairs.max(initial=0)) + 1
    keys, edge = np.unique(pairs[:, 0] * size + pairs[:, 1], return_inverse=True)
    return np.stack([keys // size, keys % size], axis=1), edge.reshape(-1, len(local))


def find(ends: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Indices (…) into ``ends``, as ``edges_of`` gives them, of pairs (…, 2) of nodes that are
    edges.
    """
    size = int(ends.max(initial=0)) + 1
    low, high = pairs.min(axis=-1), pairs.max(axis=-1)
    return np.searchsorted(ends[:, 0] * size + ends[:, 1], low * size + high)


def lines_of(triangles: np.ndarray) -> np.ndarray:
    """(3k, 3) int, ends and middles of the edges of triangles (k, 6)."""
    return np.concatenate([triangles[:, [*ends, 3 + i]] for i, ends in enumerate(TRIANGLE_EDGES)])


def with_middles(inner: np.ndarray, lines: np.ndarray, points: np.ndarray,
                 cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A sole's points and cells (q, 10) with a node in the middle of every edge.

    inner : (n, 3) nodes of the interface
    lines : (e, 3) int, ends and middles of the edges that have all of them among ``inner``
    points : (p, 3) the sole's other corners; cells : (q, 4) int, values from n on mean ``points``
    """
    n = len(inner)
    ends, edge = edges_of(cells, TET_EDGES)
    known, own = edges_of(lines, np.array([[0, 1]]))
    middle_of = np.empty(len(known), dtype=int)
    middle_of[own[:, 0]] = lines[:, 2]
    on = ends[:, 1] < n
    middle = np.empty(len(ends), dtype=int)
    middle[on] = middle_of[find(known, ends[on])]
    middle[~on] = n + len(points) + np.arange(np.count_nonzero(~on))
    return (np.vstack([points, np.vstack([inner, points])[ends[~on]].mean(axis=1)]),
            np.hstack([cells, middle[edge]]))


def six_functions(at: np.ndarray) -> np.ndarray:
    """(…, 6) quadratic functions of a triangle at barycentric coordinates (…, 3)."""
    a, b, c = np.moveaxis(at, -1, 0)
    return np.stack([a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c,
                     4 * c * a], axis=-1)


def tet_functions(at: np.ndarray, count: int) -> np.ndarray:
    """(count,) shape functions of a tet of 4 or 10 nodes at barycentric coordinates (4,)."""
    if count == 4:
        return at
    i, j = TET_EDGES.T
    return np.concatenate([at * (2 * at - 1), 4 * at[i] * at[j]])


def quadratic_slopes(at: np.ndarray) -> np.ndarray:
    """(10, 4) derivatives of the quadratic shape functions λᵢ(2λᵢ − 1), 4λᵢλⱼ by the barycentric
    coordinates λ.
    """
    i, j = TET_EDGES.T
    slopes, edge = np.zeros((10, 4)), 4 + np.arange(6)
    slopes[range(4), range(4)] = 4 * at - 1
    slopes[edge, i], slopes[edge, j] = 4 * at[j], 4 * at[i]
    return slopes


# Unknowns of ten-node tets beyond which they are not taken unasked: some 8 kB each, measured
# (assembly, 186,000 unknowns,
# 1.8 GB), a dozen GB. A number, not what is free here and now: the same input gives the same result
# everywhere.
LARGEST = 1_500_000
LOCKING = 0.45  # Poisson's ratio from which four-node tets move visibly too little


@dataclass(frozen=True)
class Choice:
    """P1 or P2, and why, in words."""

    element: str
    why: str

    def __str__(self) -> str:
        return f"{self.element}: {self.why}"


def stiffest(materials: list[Any], cell_material: np.ndarray) -> float:
    """Largest ratio of Poisson of cells; of none where materials and cell_material are empty, which
    is told elsewhere.
    """
    return max((materials[m].poisson for m in np.unique(cell_material) if m >= 0),
               default=0.0) if materials else 0.0


def choose_element(unknowns: int, poisson: float, foreign: bool = False) -> Choice:
    """Element to take for a mesh that would have some unknowns with ten-node tets.

    poisson : as ``stiffest``; foreign : whether parts are of other programs
    """
    if foreign:
        return Choice("P1", "parts of other programs are met by four-node tets alone")
    if unknowns > LARGEST:
        return Choice("P1",
                      f"ten-node tets would have {unknowns:,} unknowns, which takes more memory "
                      "than most machines have; but " + (
            f"four-node tets lock at ν = {poisson:g}: a coarser mesh with element: P2 is better"
            if poisson > LOCKING else
            "where there are fewer than four elements across a part, four-node tets are too stiff "
            "in bending"))
    if poisson > LOCKING:
        return Choice("P2", f"ν = {poisson:g}, at which four-node tets lock")
    return Choice("P2",
                  f"{unknowns:,} unknowns are not many, and ten-node tets, not too stiff in "
                  "bending, gain more accuracy than they cost")
