"""Cutting a mesh in subdomains: by slices, grid, METIS or named volumes; subdomains that are much
larger than others, cut further.

The pieces of a volume are joined by perfect interfaces whatever the laws between bodies are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from orchestrator.errors import wrong
from orchestrator.optional import Late
from orchestrator.scene.mesh.faces import by_label, Faces, links, pieces
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh, split_numbering
from orchestrator.scene.names import unique_names
from orchestrator.timing import EXPONENT, predicted_cost

pymetis = Late("pymetis")
PATH = ("subdomains",)
AXES = "xyz"


@dataclass(frozen=True)
class Partition:
    """``subdomain`` (m,) int per tet, and for each subdomain a name and the name of the body it is
    a piece of.

    Where bodies are not cut further, both names are the same and ``bodies`` may be left out.
    """

    subdomain: np.ndarray
    names: list[str]
    bodies: list[str] = field(default_factory=list)

    def body(self, index: int) -> str:
        """Name of the body that a subdomain is a piece of."""
        return self.bodies[index] if self.bodies else self.names[index]


def slices(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """Slices of equal thickness along ``entry.axis``, by the tets' centroids."""
    count, axis = _counted(int(entry.count), len(mesh.cells)), AXES.index(entry.axis)
    return Partition(layers(mesh, axis, count), [f"slice {i}" for i in range(count)])


def grid(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """Equal blocks, ``entry`` of them along x, y, z, by the tets' centroids; named by their
    indices.
    """
    counts = [int(c) for c in entry]
    _counted(min(counts) if min(counts) < 1 else int(np.prod(counts)), len(mesh.cells))
    index = np.ravel_multi_index([layers(mesh, axis, c) for axis, c in enumerate(counts)], counts)
    return Partition(index, ["block {}-{}-{}".format(*i) for i in np.ndindex(*counts)])


def metis(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """``entry`` connected parts of about equal size.

    Every connected piece of every volume is cut by itself, so that no part straddles two solids.

    Raises InputError: more connected pieces than parts
    """
    count = _counted(int(entry), len(mesh.cells))
    number, body = pieces(faces, mesh.volume)
    if count < number:
        raise wrong((*PATH, "metis"), f"{count} parts for {number} separate bodies",
                    f"at least {number}, because no part may straddle two bodies",
                    f"ask for {number} parts or more")
    first = np.unique(body, return_index=True)[1]
    # Bodies in the order of the volumes, so that part numbers follow the volumes.
    order = np.argsort(mesh.volume[first], kind="stable")
    shares = _shares(np.bincount(body)[order], count)
    of = [f" of {name}" if len(mesh.volumes) > 1 else "" for name in mesh.volumes]
    return Partition(cut(faces, np.argsort(order)[body], shares),
                     [f"part {i}{of[v]}"
                      for i, v in enumerate(np.repeat(mesh.volume[first][order], shares))])


def groups(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """One subdomain per named volume."""
    return Partition(mesh.volume.copy(), list(mesh.volumes))


METHODS: dict[str,
              Callable[[Mesh, Faces, Any], Partition]] = {"slices": slices, "grid": grid,
                                                          "metis": metis, "groups": groups}


def make_partition(mesh: Mesh, faces: Faces, subdomains: Any) -> Partition:
    """Cuts the mesh as the configuration's ``subdomains`` entry says.

    Raises InputError: counts out of range, empty or disconnected subdomains
    """
    kind, entry = next((key, given) for key in METHODS
                       if (given := getattr(subdomains, key, None)) is not None)
    partition = METHODS[kind](mesh, faces, entry)
    _check_empty(partition)
    _check_connected(mesh, faces, partition, kind)
    above = getattr(subdomains, "split_above", None)
    return partition if above is None else split(mesh, faces, partition.names, above)


def layers(mesh: Mesh, axis: int, count: int) -> np.ndarray:
    """(m,) int, in which of some layers of equal thickness each tet's centroid is."""
    low, high = mesh.box[:, axis]
    centroids = mesh.nodes[:, axis][mesh.cells[:, :4]].mean(axis=1)
    return np.clip(((centroids - low) / (high - low) * count).astype(int), 0, count - 1)


def _counted(count: int, cells: int) -> int:
    if not 1 <= count <= cells:
        raise wrong(PATH, f"{count} subdomains for a mesh of {cells} tets",
                    f"a count between 1 and the number of tets, {cells}",
                    "ask for fewer subdomains, or refine the mesh" if count > cells
                    else "ask for at least one subdomain")
    return count


def _check_empty(partition: Partition) -> None:
    empty = np.flatnonzero(np.bincount(partition.subdomain, minlength=len(partition.names)) == 0)
    if len(empty):
        shown = ", ".join(partition.names[i] for i in empty[:5]) + (", …" if len(empty) > 5 else "")
        raise wrong(PATH,
                    f"{len(empty)} of {len(partition.names)} subdomains without any tet: {shown}",
                    "at least one tet per subdomain",
                    "ask for fewer subdomains, or refine the mesh")


def _check_connected(mesh: Mesh, faces: Faces, partition: Partition, kind: str) -> None:
    _, piece = pieces(faces, partition.subdomain)
    sizes, first_cell = np.bincount(piece), np.unique(piece, return_index=True)[1]
    # the joints of a part whose mesh is not ours hang together through what is behind them
    own_mesh = partition.subdomain[first_cell[~mesh.is_foreign(first_cell)]]
    per_part = np.bincount(own_mesh, minlength=len(partition.names))
    broken = np.flatnonzero(per_part > 1)
    if not len(broken):
        return
    shown = []
    for i in broken[:5]:
        own = np.flatnonzero(partition.subdomain[first_cell] == i)
        smallest = own[np.argmin(sizes[own])]
        where = format_point(mesh.nodes[mesh.cells[first_cell[smallest]]].mean(axis=0))
        shown.append(
            f"{partition.names[i]} is in {per_part[i]} pieces (the smallest has {sizes[smallest]} "
            f"tets, at {where})")
    more = f"; and {len(broken) - 5} more" if len(broken) > 5 else ""
    cure = ("give each piece a group of its own, or make the pieces share faces" if kind == "groups"
            else
            f"use metis: {max(len(partition.names), pieces(faces, mesh.volume)[0])}, whose parts "
            "are always connected, or another count")
    raise wrong(PATH, f"disconnected subdomain: {'; '.join(shown)}{more}",
                "subdomains held together by shared faces", cure)


def cut(faces: Faces, body: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Cuts every body by itself in connected parts of about equal size.

    body : (m,) int, the body of each tet; each is connected through faces
    shares : (bodies,) int, in how many parts, at most one per tet
    Returns part : (m,) int; the parts of a body follow one another, bodies in their order
    """
    starts = np.r_[0, np.cumsum(shares)]
    part = np.empty(len(body), dtype=np.int64)
    a, b = links(faces, body)
    local = np.empty(len(body), dtype=np.int64)
    for start, share, cells, own in zip(starts, shares, by_label(body, len(shares)),
                                        by_label(body[a], len(shares))):
        local[cells] = np.arange(len(cells))
        part[cells] = start + _cut(local[a[own]], local[b[own]], len(cells), int(share))
    _gather_strays(faces, part, body)
    return part


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
    graph = coo_array((np.ones(2 * len(a), dtype=np.int8), (np.r_[a, b], np.r_[b, a])),
                      shape=(size, size)).tocsr()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    # METIS keeps parts connected only in its k-way mode.
    found = pymetis.part_graph(count, adjacency, recursive=False,
                               options=pymetis.Options(contig=True))
    return np.asarray(found.vertex_part, dtype=np.int64)


def _gather_strays(faces: Faces, part: np.ndarray, body: np.ndarray) -> None:
    """Gives fragments that METIS left behind to the neighbour they share most faces with, in
    place.
    """
    a, b = links(faces, body)
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
        pairs, shared = np.unique(np.c_[piece[ends[keep]], part[others[keep]]], axis=0,
                                  return_counts=True)
        best = np.lexsort((pairs[:, 1], -shared, pairs[:, 0]))
        first = best[np.r_[True, pairs[best, 0][1:] != pairs[best, 0][:-1]]]
        target = owner.copy()
        target[pairs[first, 0]] = pairs[first, 1]
        part[:] = target[piece]


# Under ``auto`` a piece may cost this many times what the volumes cost on average.
UNEVEN = 2.0


def split(mesh: Mesh, faces: Faces, names: list[str], above: int | str) -> Partition:
    """Cuts large volumes in pieces, which follow one another, ``grain_3.1``, ``grain_3.2``, …;
    others keep their names.

    names : of the volumes; each is connected
    above : dofs, three per node, that no piece of several tets exceeds; "auto": as many as are
        predicted to cost ``UNEVEN`` times the mean of the volumes
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
    numbered = [[name] if share == 1 else [f"{name}.{i}" for i in range(1, share + 1)]
                for name, share in zip(names, shares)]
    return Partition(part, unique_names([name for own in numbered for name in own]),
                     np.repeat(names, shares).tolist())


def _dofs(mesh: Mesh, part: np.ndarray, count: int) -> np.ndarray:
    """(count,) dofs of each part, three per node."""
    found = 3 * np.diff(split_numbering(mesh.cells, part, len(mesh.nodes)).offsets)
    return np.r_[found, np.zeros(count - len(found), dtype=np.int64)]
