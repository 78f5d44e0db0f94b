"""Element sizes asked for in space: given on an earlier mesh, followed by gmsh as it meshes a CAD
model.

A mesh whose tets are halved until they are as small as asked, across their longest edges (Rivara).

A tet that is to be halved is cut from the middle of its longest edge; so is, across its own longest
edge, every tet that a cut edge belongs to, until no edge is cut that is not cut in all tets around
it. The finer mesh contains the coarser one, shares faces where that did, and its tets are not much
flatter.

M. C. Rivara, Algorithms for refining triangular grids suitable for adaptive and multigrid
techniques, Int. J. Numer. Meth. Engng 20, 1984, 745–756.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.linalg import PLACED
from orchestrator.scene.mesh.faces import LOCAL_FACES, pack
from orchestrator.scene.mesh.geometry import barycentric, tet_volumes
from orchestrator.scene.mesh.gmsh_session import gmsh
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import edges_of, TET_EDGES


WHOLE = ""  # key of the map of a mesh that is made in one piece
REGULAR = 6 * np.sqrt(2)  # the cube of a regular tet's edge over its volume
# Tets that gmsh makes, over as many regular ones as the sizes ask for: .65 at 700 elements to .46
# at 80,000, even or graded, measured
FOLLOWED = 0.55


@dataclass(frozen=True)
class SizeMap:
    """Sizes on tets, linear in each, in the coordinates of the source before it is scaled or moved.

    nodes : (n, 3); cells : (m, 4) int; size : (n,) length of edges
    """

    nodes: np.ndarray
    cells: np.ndarray
    size: np.ndarray

    def apply(self) -> int:
        """A field of gmsh's that gives about as many tets, by its tag."""
        # gmsh's octree ends the program where a tet's middle is nearly on one of its planes
        astray = PLACED * np.ptp(self.nodes,
                                 axis=0).max() * np.random.default_rng(0).uniform(
                                     -1.0, 1.0, self.nodes.shape)
        corners, size = (self.nodes + astray)[self.cells].transpose(0, 2, 1).reshape(
            -1, 12), self.size * np.cbrt(FOLLOWED)
        view = gmsh.view.add("sizes")
        gmsh.view.addListData(view, "SS", len(corners),
                              np.hstack([corners, size[self.cells]]).ravel())
        field = gmsh.model.mesh.field.add("PostView")
        gmsh.model.mesh.field.setNumber(field, "ViewTag", view)
        return field


# name of a volume that is meshed by itself, or WHOLE → the sizes in it
Sizes = Mapping[str, SizeMap]


def edge_lengths(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) edges of regular tets of the same volumes."""
    return np.cbrt(REGULAR * np.abs(tet_volumes(nodes, cells)))


# A half has half the volume: tets that are cut from this size on end within a factor of 2^(1/6) of
# what is asked, either way.
OFF = 2 ** (1 / 6)
MANY = 1 << 31  # more than nodes, so that two of them make one key


def bisected(mesh: Mesh, sizes: SizeMap) -> Mesh:
    """The mesh with tets of four nodes as small as ``sizes`` at their centres, volumes and surfaces
    as they were.
    """
    from scipy.spatial import cKDTree  # for this alone

    near, parts = cKDTree(sizes.nodes[sizes.cells].mean(axis=1)), _Parts(mesh)
    while True:
        centre = parts.nodes[parts.cells].mean(axis=1)
        corners = sizes.cells[near.query(centre)[1]]
        # the nearest tet may be beside that which holds it
        share = np.clip(barycentric(sizes.nodes[corners], centre), 0.0, 1.0)
        asked = np.einsum("mk,mk->m", share, sizes.size[corners]) / share.sum(axis=1)
        too_large = edge_lengths(parts.nodes, parts.cells) > OFF * asked
        if not too_large.any():
            return replace(mesh, nodes=parts.nodes, cells=parts.cells, volume=parts.volume,
                           surfaces=parts.surfaces(), smooth={})
        parts.halve(too_large)


class _Parts:
    """Tets with what they are parts of.

    on : name of a surface → (t,) bool, whether faces of each tag lie on it; those of tag 0 do not
    tags : (m, 4) int, of the face opposite to each corner
    """

    def __init__(self, mesh: Mesh):
        self.nodes, self.cells, self.volume = mesh.nodes, mesh.cells, mesh.volume
        keys = pack(self.cells[:, LOCAL_FACES].reshape(-1, 3), len(self.nodes))
        on = [np.append(False, np.isin(keys, pack(triangles[:, :3], len(self.nodes))))
              for triangles in mesh.surfaces.values()]
        on = np.packbits(np.array(on, dtype=bool).reshape(-1, len(keys) + 1), axis=0)
        on, tags = np.unique(on, axis=1, return_inverse=True)
        self.on = dict(zip(mesh.surfaces, np.unpackbits(on, axis=0).astype(bool)))
        self.tags = tags.ravel()[1:].reshape(-1, 4)

    def surfaces(self) -> dict[str, np.ndarray]:
        """Name → (k, 3) int, outward triangles."""
        triangles, tags = self.cells[:, LOCAL_FACES].reshape(-1, 3), self.tags.ravel()
        return {name: triangles[on[tags]] for name, on in self.on.items()}

    def halve(self, chosen: np.ndarray) -> None:
        """Halves tets ``chosen`` (m,) bool, and others until all share their faces."""
        # edges by their keys, ascending, and the nodes amid them
        cut, middle = np.empty((2, 0), dtype=np.int64)
        while chosen.any():
            ends, edge = edges_of(self.cells, TET_EDGES)
            keys = ends[:, 0] * MANY + ends[:, 1]
            order = np.lexsort(
                (keys, np.sum((self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]]) ** 2, axis=1)))
            rank = np.empty_like(order)
            rank[order] = np.arange(len(order))
            halved = np.flatnonzero(chosen)
            local = rank[edge[halved]].argmax(axis=1)
            longest = edge[halved, local]
            new = np.setdiff1d(longest, np.flatnonzero(np.isin(keys, cut)))
            cut, middle = np.concatenate([cut, keys[new]]), np.concatenate(
                [middle, len(self.nodes) + np.arange(len(new))])
            cut, middle = cut[order := np.argsort(cut)], middle[order]
            self.nodes = np.concatenate([self.nodes, self.nodes[ends[new]].mean(axis=1)])
            self._cut(halved, TET_EDGES[local], middle[np.searchsorted(cut, keys[longest])])
            ends, edge = edges_of(self.cells, TET_EDGES)
            chosen = np.isin(ends[:, 0] * MANY + ends[:, 1], cut)[edge].any(axis=1)

    def _cut(self, halved: np.ndarray, ends: np.ndarray, node: np.ndarray) -> None:
        """Replaces each of some tets (h,) int by two, in each of which ``node`` (h,) stands for one
        of the ``ends`` (h, 2), local corners.

        The face between the two, opposite to the end that is left, is on no surface.
        """
        rows, halves, tags = np.arange(len(halved)), [], []
        for lost, left in (ends.T, ends.T[::-1]):
            half, tag = self.cells[halved].copy(), self.tags[halved].copy()
            half[rows, lost], tag[rows, left] = node, 0
            halves.append(half)
            tags.append(tag)
        kept = np.delete(np.arange(len(self.cells)), halved)
        self.volume = np.concatenate([self.volume[kept], self.volume[halved], self.volume[halved]])
        self.cells, self.tags = np.concatenate([self.cells[kept], *halves]), np.concatenate(
            [self.tags[kept], *tags])
