"""The faces of a tetrahedral mesh: who shares them, which lie on the outside, what they connect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from orchestrator.kept import Unchanging

# The four faces of a positively oriented tet, each oriented outward.
LOCAL_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])

# Three node ids are packed in one 64-bit key.
MAX_NODES = 2_097_151


@dataclass(frozen=True)
class Faces(Unchanging):
    """All faces of a mesh, each once, in the order of their keys.

    nodes : number of corner nodes of the mesh
    triangles : (f, 3) int, oriented outward of the owner; (f, 6) on ten-node tets, the corners
        first
    keys : (f,) int, ascending; equal keys mean the same three nodes
    owner, neighbour : (f,) int, the tets on both sides; the neighbour is -1 on the outer boundary
    crowded : indices of faces that three or more tets claim
    folded : indices of inner faces that have both tets on the same side (overlap)
    """

    nodes: int
    triangles: np.ndarray
    keys: np.ndarray
    owner: np.ndarray
    neighbour: np.ndarray
    crowded: np.ndarray
    folded: np.ndarray

    @property
    def outer(self) -> np.ndarray:
        """Indices of the faces on the outer boundary."""
        return np.flatnonzero(self.neighbour < 0)

    @property
    def inner(self) -> np.ndarray:
        """Indices of the faces between two tets."""
        return np.flatnonzero(self.neighbour >= 0)

    def find(self, triangles: np.ndarray) -> np.ndarray:
        """Indices (k,) of the faces with these nodes, whatever their orientation; -1 where there is
        none.
        """
        keys = pack(triangles, self.nodes)
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[at] == keys, at, -1)


def pack(triangles: np.ndarray, nodes: int) -> np.ndarray:
    """One integer per triangle (k, 3) that does not depend on the order of its nodes."""
    a, b, c = triangles.T
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    return (low * nodes + (a + b + c - low - high)) * nodes + high


def alike(known: np.ndarray, triangles: np.ndarray, nodes: int) -> np.ndarray:
    """Indices (k,) of the known (m, 3 or 6) that have the corners of triangles (k, 3 or 6), the
    last
    of several, whatever their orientation; -1 where there is none."""
    keys, wanted = (pack(t[:, :3], nodes) for t in (known, triangles))
    order = np.argsort(keys, kind="stable")
    at = order[np.searchsorted(keys, wanted, side="right", sorter=order) - 1]
    return np.where(keys[at] == wanted, at, -1)


def faces_of(cells: np.ndarray, nodes: int) -> Faces:
    """The faces of tets (m, 4), positively oriented, of a mesh of some nodes; raises ValueError for
    more than ``MAX_NODES``.
    """
    if nodes > MAX_NODES:
        raise ValueError(f"{nodes} nodes; at most {MAX_NODES} are possible")
    each = cells[:, LOCAL_FACES].reshape(-1, 3)
    keys = pack(each, nodes)
    # A stable order makes the tet with the lower index the owner.
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    start = np.flatnonzero(np.r_[len(keys) > 0, keys[1:] != keys[:-1]])
    count = np.diff(np.r_[start, len(keys)])
    first, second = order[start], order[np.minimum(start + 1, len(order) - 1)]
    triangles, others = each[first], each[second]
    same_way = (count > 1) & (_even(triangles) == _even(others))
    return Faces(nodes, triangles, keys[start], first // 4, np.where(count > 1, second // 4, -1),
                 np.flatnonzero(count > 2),
                 np.flatnonzero(same_way))


def _even(triangles: np.ndarray) -> np.ndarray:
    """(k,) bool, whether the nodes are an even permutation of their ascending order."""
    a, b, c = triangles.T
    return (a < b) ^ (b < c) ^ (a < c)


def links(faces: Faces, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of tets of equal labels (m,) that share a face, each pair once."""
    inner = faces.inner
    a, b = faces.owner[inner], faces.neighbour[inner]
    same = labels[a] == labels[b]
    return a[same], b[same]


def pieces(faces: Faces, labels: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of parts of the mesh that faces between tets of equal labels (m,) hold together, and
    the part (m,) of each tet.
    """
    return components(*links(faces, labels), len(labels))


def components(a: np.ndarray, b: np.ndarray, size: int) -> tuple[int, np.ndarray]:
    """Connected components of the graph with edges a[i]–b[i] on ``size`` vertices: count, (size,)
    labels, ascending with the lowest vertex of each.
    """
    if not size:
        return 0, np.empty(0, dtype=int)
    graph = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(size, size))
    count, label = connected_components(graph, directed=False)
    return count, label.astype(int)


def renumbered(elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes (n,) int, ascending, of elements (m, p), and these by places among them."""
    nodes, local = np.unique(elements, return_inverse=True)
    return nodes, local.reshape(elements.shape)


def by_label(label: np.ndarray, count: int = 0) -> list[np.ndarray]:
    """Return the places (…,) int, ascending, of each label 0, 1, … among ``label`` (n,), of
    ``count`` labels at least."""
    ends = np.cumsum(np.bincount(label, minlength=count))
    return np.split(np.argsort(label, kind="stable"), ends)[:-1]


def runs(starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return (sum of lengths,) int, whole numbers from each start (k,) on, as many as its length
    (k,) says, run after run.
    """
    return np.repeat(starts - (np.cumsum(lengths) - lengths), lengths) + np.arange(lengths.sum())


def edge_patches(triangles: np.ndarray, group: np.ndarray | None = None) -> tuple[int, np.ndarray]:
    """Patches of triangles (k, 3 or 6) of the same group (k,) connected through edges: count, and
    the patch (k,) of each.

    Patches are numbered in the order of their first triangles.
    """
    size, corners = len(triangles), np.sort(triangles[:, :3], axis=1)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])
    edge = np.unique(edges[:, 0] * (np.int64(edges.max(initial=0)) + 1) + edges[:, 1],
                     return_inverse=True)[1]
    if group is not None:  # two groups may meet at an edge: it must not join their patches
        edge = np.unique(np.tile(group, 3) * (np.int64(edge.max(initial=0)) + 1) + edge,
                         return_inverse=True)[1]
    # Triangles and edges are the two kinds of vertices of one graph.
    count, label = components(np.tile(np.arange(size), 3), size + edge,
                              size + int(edge.max(initial=-1)) + 1)
    return count, label[:size]
