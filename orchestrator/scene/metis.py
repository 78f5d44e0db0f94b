"""Connected parts of about equal size, by METIS on the tets' face adjacency; volumes that are much larger than others, cut further.

The pieces of a volume are joined by perfect interfaces whatever the laws between bodies are.
"""

from __future__ import annotations

import numpy as np
import pymetis
from scipy.sparse import coo_array

from orchestrator.timing import EXPONENT, predicted_cost
from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.mesh import Mesh, split_numbering
from orchestrator.scene.names import unique_names


def metis(mesh: Mesh, faces: Faces, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cuts every connected piece of every volume by itself, so that no part straddles two solids.

    count : number of parts in all
    Returns part : (m,) int
    volume : (count,) int, the volume each part belongs to
    Raises InputError: more connected pieces than parts
    """
    number, body = pieces(faces, mesh.volume)
    if count < number:
        raise InputError(Problem(("subdomains", "metis"), f"{count} parts for {number} separate bodies",
                                 f"at least {number}, because no part may straddle two bodies", f"ask for {number} parts or more"))
    first = np.unique(body, return_index=True)[1]
    # Bodies in the order of the volumes, so that part numbers follow the volumes.
    order = np.argsort(mesh.volume[first], kind="stable")
    shares = _shares(np.bincount(body)[order], count)
    return cut(faces, np.argsort(order)[body], shares), np.repeat(mesh.volume[first][order], shares)


def cut(faces: Faces, body: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Cuts every body by itself in connected parts of about equal size.

    body : (m,) int, the body of each tet; each is connected through faces
    shares : (bodies,) int, in how many parts, at most one per tet
    Returns part : (m,) int; the parts of a body follow one another, bodies in their order
    """
    starts = np.r_[0, np.cumsum(shares)]
    part = np.empty(len(body), dtype=np.int64)
    a, b = _links(faces, body)
    by_body = np.argsort(body, kind="stable")
    cell_range = np.searchsorted(body[by_body], np.arange(len(shares) + 1))
    link_order = np.argsort(body[a], kind="stable")
    link_range = np.searchsorted(body[a][link_order], np.arange(len(shares) + 1))
    local = np.empty(len(body), dtype=np.int64)
    for i, share in enumerate(shares):
        cells = by_body[cell_range[i]:cell_range[i + 1]]
        links = link_order[link_range[i]:link_range[i + 1]]
        local[cells] = np.arange(len(cells))
        part[cells] = starts[i] + _cut(local[a[links]], local[b[links]], len(cells), int(share))
    _gather_strays(faces, part, body)
    return part


def _links(faces: Faces, body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of tets of the same body that share a face, each pair once."""
    inner = faces.inner
    a, b = faces.owner[inner], faces.neighbour[inner]
    same = body[a] == body[b]
    return a[same], b[same]


def _shares(sizes: np.ndarray, count: int) -> np.ndarray:
    """Parts per body, proportional to its size, at least one each, ``count`` in all."""
    shares = np.ones(len(sizes), dtype=np.int64)
    if count > len(sizes):
        ideal = sizes / sizes.sum() * count
        shares = np.maximum(np.floor(ideal).astype(np.int64), 1)
        while shares.sum() > count:
            shares[np.argmax(np.where(shares > 1, shares - ideal, -np.inf))] -= 1
        while shares.sum() < count:
            shares[np.argmax(np.where(shares < sizes, ideal - shares, -np.inf))] += 1
    return shares


def _cut(a: np.ndarray, b: np.ndarray, size: int, count: int) -> np.ndarray:
    if count == 1:
        return np.zeros(size, dtype=np.int64)
    if count == size:
        return np.arange(size)
    graph = coo_array((np.ones(2 * len(a), dtype=np.int8), (np.r_[a, b], np.r_[b, a])), shape=(size, size)).tocsr()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    # METIS keeps parts connected only in its k-way mode.
    found = pymetis.part_graph(count, adjacency, recursive=False, options=pymetis.Options(contig=True))
    return np.asarray(found.vertex_part, dtype=np.int64)


def _gather_strays(faces: Faces, part: np.ndarray, body: np.ndarray) -> None:
    """Gives fragments that METIS left behind to the neighbour they share most faces with, in place."""
    a, b = _links(faces, body)
    while True:
        number, piece = pieces(faces, part)
        sizes = np.bincount(piece)
        owner = part[np.unique(piece, return_index=True)[1]]
        # The largest piece of each part, the first of equals.
        by_size = np.lexsort((-sizes, owner))
        main = by_size[np.r_[True, owner[by_size][1:] != owner[by_size][:-1]]]
        stray = np.ones(number, dtype=bool)
        stray[main] = False
        if not stray.any():
            return
        ends, others = np.r_[a, b], np.r_[b, a]
        keep = stray[piece[ends]] & ~stray[piece[others]] & (part[ends] != part[others])
        if not keep.any():
            return
        pairs, shared = np.unique(np.c_[piece[ends[keep]], part[others[keep]]], axis=0, return_counts=True)
        best = np.lexsort((pairs[:, 1], -shared, pairs[:, 0]))
        first = best[np.r_[True, pairs[best, 0][1:] != pairs[best, 0][:-1]]]
        target = owner.copy()
        target[pairs[first, 0]] = pairs[first, 1]
        part[:] = target[piece]


# Under ``auto`` a piece may cost this many times what the volumes cost on average.
UNEVEN = 2.0


def split(mesh: Mesh, faces: Faces, names: list[str], above: int | str) -> tuple[np.ndarray, list[str], list[str]]:
    """Cuts large volumes in pieces.

    names : of the volumes; each is connected
    above : dofs, three per node, that no piece of several tets exceeds; "auto": as many as are predicted
        to cost ``UNEVEN`` times the mean of the volumes
    Returns subdomain : (m,) int per tet; the pieces of a volume follow one another
    names : of the subdomains: the volume's, or with a number from 1 for each piece, ``grain_3.1``
    bodies : names of the volumes they are pieces of
    """
    sizes = np.bincount(mesh.volume)
    part, shares = mesh.volume, np.ones(len(names), dtype=np.int64)
    dofs = _dofs(mesh, part, len(shares))
    limit = (UNEVEN * predicted_cost(dofs).mean()) ** (1 / EXPONENT) if above == "auto" else above
    while True:
        largest = np.maximum.reduceat(dofs, np.cumsum(shares) - shares)
        more = (largest > limit) & (shares < sizes)
        if not more.any():
            break
        # nodes on the cuts count twice: the pieces' dofs decide, not the number of pieces
        wanted = np.maximum(np.ceil(shares * largest / limit).astype(np.int64), shares + 1)
        shares = np.where(more, np.minimum(wanted, sizes), shares)
        part = cut(faces, mesh.volume, shares)
        dofs = _dofs(mesh, part, shares.sum())
    body = np.repeat(np.arange(len(names)), shares)[dofs > 0]  # METIS may leave parts empty
    part = np.unique(part, return_inverse=True)[1]
    shares = np.bincount(body)
    numbered = [[name] if share == 1 else [f"{name}.{i}" for i in range(1, share + 1)] for name, share in zip(names, shares)]
    return part, unique_names([name for own in numbered for name in own]), np.repeat(names, shares).tolist()


def _dofs(mesh: Mesh, part: np.ndarray, count: int) -> np.ndarray:
    """(count,) dofs of each part, three per node."""
    found = 3 * np.diff(split_numbering(mesh.cells, part, len(mesh.nodes)).offsets)
    return np.r_[found, np.zeros(count - len(found), dtype=np.int64)]
