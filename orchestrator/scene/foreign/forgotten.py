"""Nodes that a joint's node set seems to lack: its faces go on round them.

Where a joint ends, the faces beyond have other nodes outside too; where a node was forgotten, all faces round it, as far as the
surface goes on smoothly, have all corners in the set but this one. Nodes in the middle of edges are missed where a face has
all its corners in the set.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

SMOOTH = 0.5  # cosine between normals of faces, up to which edges are none: those of a bore of six facets count as smooth
NAMED = 6  # nodes


def forgotten(faces: list[np.ndarray], own: np.ndarray, ids: np.ndarray, points: np.ndarray, name: str) -> list[str]:
    """A sentence on nodes that seem to be forgotten, or none.

    Parameters
    ----------
    faces : tables (f, 3, 4, 6 or 8), numbers of nodes of all outer faces, corners first
    own : numbers of the set's nodes
    ids : (n,) ascending, points : (n, 3), all nodes
    name : of the joint
    """
    count = [4 if table.shape[1] in (4, 8) else 3 for table in faces]
    corners = np.concatenate([table[:, np.arange(4) % c] for table, c in zip(faces, count)])  # a triangle's first corner comes twice
    quad = np.repeat([c == 4 for c in count], [len(table) for table in faces])
    inside = np.isin(corners, own)
    out = (~inside).sum(axis=1) - (~quad & ~inside[:, 0])
    whole = np.concatenate([np.isin(table, own).all(axis=1) for table in faces])
    x = points[np.searchsorted(ids, corners)]
    normal = np.cross(x[:, 2] - x[:, 0], np.where(quad[:, None], x[:, 3], x[:, 2]) - x[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    beside = _smooth(corners, quad, normal, np.flatnonzero(~whole & (out <= 1)), np.flatnonzero(whole), 2)
    lacks = np.unique(beside[0])
    single = lacks[out[lacks] == 1]
    missing = corners[single, (~inside[single]).argmax(axis=1)]
    around, others = _smooth(np.where(inside, -1, corners), quad, normal, single, np.flatnonzero(out > 0), 1)
    keep = ~np.isin(single, around[out[others] > 1])  # no face beyond the joint's end
    # where nodes in the middle of edges are missing too, that may be a corner left out on purpose, unless faces are all round it
    alone = np.concatenate([(~np.isin(table, own)).sum(axis=1) for table in faces])[single] == 1
    keep &= alone | (_count(missing, missing) == _count(np.concatenate([table[:, :c].ravel() for table, c in zip(faces, count)]), missing))
    nodes, faces_told = [missing[keep]], int(keep.sum())
    for table, at in zip(faces, np.split(np.arange(len(corners)), np.cumsum([len(table) for table in faces])[:-1])):
        of_edges = table[np.isin(at, lacks[out[lacks] == 0])]
        nodes.append(of_edges[~np.isin(of_edges, own)])
        faces_told += len(of_edges)
    lost = np.unique(np.concatenate(nodes)).tolist()
    if not lost:
        return []
    named = ", ".join(map(str, lost[:NAMED])) + (" …" if len(lost) > NAMED else "")
    return [f"{name}: faces beside its own, {faces_told} of them, have all other nodes in its set, but not {named}: are these forgotten?"]


def _count(among: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """How often each of the nodes is among others."""
    ordered = np.sort(among)
    return np.searchsorted(ordered, nodes, "right") - np.searchsorted(ordered, nodes)


def _smooth(corners: np.ndarray, quad: np.ndarray, normal: np.ndarray, first: np.ndarray, second: np.ndarray,
            least: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of faces, of the first and the second, that share so many corners (-1: none) at least and no edge is between."""
    place = np.unique(corners, return_inverse=True)[1].reshape(corners.shape)
    valid = corners >= 0
    valid[:, 3] &= quad
    row, column = np.nonzero(valid)
    table = sp.csr_array((np.ones(len(row)), (row, place[row, column])), shape=(len(corners), int(place.max(initial=0)) + 1))
    shared = (table[first] @ table[second].T).tocoo()
    a, b = first[shared.row], second[shared.col]
    good = (shared.data >= least) & (np.einsum("ij,ij->i", normal[a], normal[b]) > SMOOTH)
    return a[good], b[good]
