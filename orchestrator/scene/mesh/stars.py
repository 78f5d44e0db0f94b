"""A mesh that is changed in few places: the tets around nodes, and which edges may vanish without tearing anything."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.mesh import Mesh

# Directions this close to a plane (sine of the angle) lie in it; components this small are rounding.
IN_PLANE, ROUNDING = 1e-6, 1e-12


class Stars:
    """The tets of a mesh with those beyond its outer surface, around each node.

    Beyond every outer triangle lies an imagined tet, up to one node at infinity, which belongs to the triangle's
    named surface as others belong to their volume. So what bounds volumes and what bounds the mesh is one kind of
    face, between tets of different regions, and nothing has an outside.

    Attributes
    ----------
    nodes : (n, 3) coordinates
    cells : (m, 4) int, the mesh's tets, then the imagined ones, whose last node is n
    region : (m,) int, index of the volume; surfaces follow
    real : how many tets are the mesh's
    alive : (m,) bool, tets that have not vanished
    """

    def __init__(self, mesh: Mesh):
        self.mesh, self.nodes, self.real, n = mesh, mesh.nodes.copy(), len(mesh.cells), len(mesh.nodes)
        beyond = [np.c_[triangles, np.full(len(triangles), n)] for triangles in mesh.surfaces.values()]
        self.cells = np.concatenate([mesh.cells, *beyond])
        self.region = np.concatenate([mesh.volume, np.repeat(len(mesh.volumes) + np.arange(len(beyond)),
                                                             [len(part) for part in beyond])])
        self.alive = np.ones(len(self.cells), dtype=bool)
        order = np.argsort(self.cells.reshape(-1), kind="stable")
        self._cells_by_node = order // 4
        self._start = np.searchsorted(self.cells.reshape(-1)[order], np.arange(n + 1))
        self._gained: dict[int, list[int]] = {}

    def star(self, node: int) -> np.ndarray:
        """Tets at a node, ascending."""
        around = self._cells_by_node[self._start[node]:self._start[node + 1]]
        around = np.concatenate([around, np.array(self._gained.get(node, []), dtype=int)])
        return np.unique(around[self.alive[around]])

    def free(self, node: int, bend: bool = False) -> np.ndarray:
        """(3, k) orthonormal directions in which a node moves within all faces between regions that it lies on.

        Parameters
        ----------
        bend : faces between two volumes may bend
        """
        cells_at: dict[tuple[int, ...], list[int]] = {}
        for cell in self.star(node).tolist():
            for pair in combinations(sorted(v for v in self.cells[cell].tolist() if v != node), 2):
                cells_at.setdefault(pair, []).append(cell)
        between = [(node, *pair) for pair, (one, other) in cells_at.items()
                   if pair[1] < len(self.nodes) and self.region[one] != self.region[other]
                   and not (bend and max(one, other) < self.real)]
        if not between:
            return np.eye(3)
        normals = area_vectors(self.nodes, np.array(between))
        _, lengths, axes = np.linalg.svd(normals / np.linalg.norm(normals, axis=1)[:, None])
        rank = int(np.sum(lengths > IN_PLANE * lengths[0]))
        free = axes[rank:].T
        return np.where(np.abs(free) < ROUNDING, 0.0, free)  # so that what lies on a side of a box stays on it exactly

    def may_merge(self, u: int, v: int) -> bool:
        """Whether nodes u and v of an edge can become one so that every region stays what it is: a ball stays a ball.

        This is so when what surrounds both surrounds their edge: among all tets, in each region and on its surface
        (the link conditions of Dey, Edelsbrunner, Guha & Nekhayev, Publ. Inst. Math. 66, 1999). Faces between two
        regions stay in one piece, or vanish where they are a triangle with one side too short.
        """
        at_u, at_v = self.star(u), self.star(v)
        around_u, around_v = set(self.region[at_u].tolist()), set(self.region[at_v].tolist())
        around_edge = set(self.region[np.intersect1d(at_u, at_v)].tolist())
        if len(around_edge) == 2 and len(around_u) > 2 and len(around_v) > 2:
            return False  # a face between two regions would be cut in two
        if _links_meet_elsewhere(self.cells[at_u], self.cells[at_v], u, v):
            return False
        for region in around_u & around_v:
            inside_u, inside_v = (self.cells[at[self.region[at] == region]] for at in (at_u, at_v))
            if _links_meet_elsewhere(inside_u, inside_v, u, v):
                return False
            surface_u, surface_v = _surface(inside_u, u), _surface(inside_v, v)
            if len(surface_u) and len(surface_v) and _links_meet_elsewhere(surface_u, surface_v, u, v):
                return False
        return True

    def merge(self, u: int, v: int) -> None:
        """Node u becomes node v."""
        around = self.star(u)
        both = np.any(self.cells[around] == v, axis=1)
        self.alive[around[both]] = False
        moved = around[~both]
        self.cells[moved] = np.where(self.cells[moved] == u, v, self.cells[moved])
        self._gained.setdefault(v, []).extend(moved.tolist())

    def compact(self) -> Mesh:
        """The mesh as it is now, without what has vanished."""
        kept, mesh = np.flatnonzero(self.alive), self.mesh
        inside, beyond = kept[kept < self.real], kept[kept >= self.real]
        used, cells = np.unique(self.cells[inside], return_inverse=True)
        surfaces = {name: np.searchsorted(used, self.cells[beyond[self.region[beyond] == len(mesh.volumes) + i], :3])
                    for i, name in enumerate(mesh.surfaces)}
        return Mesh(self.nodes[used], cells.reshape(-1, 4), self.region[inside], mesh.volumes, surfaces, mesh.source,
                    list(mesh.remarks))


def _simplices(cells: np.ndarray, node: int) -> set[frozenset[int]]:
    """The link of a node: all sides and corners of what faces it in its tets or triangles."""
    return _parts([[v for v in cell if v != node] for cell in cells.tolist()])


def _parts(simplices: list[list[int]]) -> set[frozenset[int]]:
    """Simplices, their sides and their corners."""
    return {frozenset(part) for nodes in simplices for k in range(1, len(nodes) + 1) for part in combinations(nodes, k)}


def _links_meet_elsewhere(at_u: np.ndarray, at_v: np.ndarray, u: int, v: int) -> bool:
    """Whether the links of two nodes have more in common than the link of their edge; or there is no such edge."""
    edge = [[w for w in cell if w not in (u, v)] for cell in at_u.tolist() if v in cell]
    return not edge or _simplices(at_u, u) & _simplices(at_v, v) != _parts(edge)


def _surface(cells: np.ndarray, node: int) -> np.ndarray:
    """(k, 3) those triangles at a node that only one of its tets has."""
    triangles: dict[tuple[int, ...], int] = {}
    for cell in cells.tolist():
        for pair in combinations(sorted(v for v in cell if v != node), 2):
            triangles[pair] = triangles.get(pair, 0) + 1
    single = [(node, *pair) for pair, count in triangles.items() if count == 1]
    return np.array(single, dtype=int).reshape(-1, 3)
