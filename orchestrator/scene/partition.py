"""Cutting a mesh in subdomains: by slices, grid, METIS or named volumes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.geometry import format_point

PATH = ("subdomains",)
AXES = "xyz"


@dataclass(frozen=True)
class Partition:
    """``subdomain`` (m,) int per tet, and for each subdomain a name and the name of the body it is a piece of.

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
    return Partition(_layers(mesh, axis, count), [f"slice {i}" for i in range(count)])


def grid(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """Equal blocks, ``entry`` of them along x, y, z, by the tets' centroids; named by their indices."""
    counts = [int(c) for c in entry]
    _counted(min(counts) if min(counts) < 1 else int(np.prod(counts)), len(mesh.cells))
    index = np.ravel_multi_index([_layers(mesh, axis, c) for axis, c in enumerate(counts)], counts)
    return Partition(index, ["block {}-{}-{}".format(*i) for i in np.ndindex(*counts)])


def parts(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """``entry`` connected parts of about equal size, none of them in two volumes."""
    from orchestrator.scene.metis import metis  # the others need neither METIS nor sparse matrices

    index, volume = metis(mesh, faces, _counted(int(entry), len(mesh.cells)))
    if len(mesh.volumes) == 1:
        return Partition(index, [f"part {i}" for i in range(len(volume))])
    return Partition(index, [f"part {i} of {mesh.volumes[v]}" for i, v in enumerate(volume)])


def groups(mesh: Mesh, faces: Faces, entry: Any) -> Partition:
    """One subdomain per named volume."""
    return Partition(mesh.volume.copy(), list(mesh.volumes))


METHODS: dict[str, Callable[[Mesh, Faces, Any], Partition]] = {
    "slices": slices, "grid": grid, "metis": parts, "groups": groups,
}


def make_partition(mesh: Mesh, faces: Faces, subdomains: Any) -> Partition:
    """Cuts the mesh as the configuration's ``subdomains`` entry says.

    Raises InputError: counts out of range, empty or disconnected subdomains
    """
    kind, entry = next((key, given) for key in METHODS if (given := getattr(subdomains, key, None)) is not None)
    partition = METHODS[kind](mesh, faces, entry)
    _check_empty(partition)
    _check_connected(mesh, faces, partition, kind)
    above = getattr(subdomains, "split_above", None)
    if above is None:
        return partition
    from orchestrator.scene.metis import split  # by METIS, as above

    return Partition(*split(mesh, faces, partition.names, above))


def _layers(mesh: Mesh, axis: int, count: int) -> np.ndarray:
    low, high = mesh.nodes[:, axis].min(), mesh.nodes[:, axis].max()
    centroids = mesh.nodes[:, axis][mesh.cells[:, :4]].mean(axis=1)
    return np.clip(((centroids - low) / (high - low) * count).astype(int), 0, count - 1)


def _counted(count: int, cells: int) -> int:
    if not 1 <= count <= cells:
        raise InputError(Problem(PATH, f"{count} subdomains for a mesh of {cells} tets",
                                 f"a count between 1 and the number of tets, {cells}",
                                 "ask for fewer subdomains, or refine the mesh" if count > cells else "ask for at least one subdomain"))
    return count


def _check_empty(partition: Partition) -> None:
    empty = np.flatnonzero(np.bincount(partition.subdomain, minlength=len(partition.names)) == 0)
    if len(empty):
        shown = ", ".join(partition.names[i] for i in empty[:5]) + (", …" if len(empty) > 5 else "")
        raise InputError(Problem(PATH, f"{len(empty)} of {len(partition.names)} subdomains without any tet: {shown}",
                                 "at least one tet per subdomain", "ask for fewer subdomains, or refine the mesh"))


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
        shown.append(f"{partition.names[i]} is in {per_part[i]} pieces (the smallest has {sizes[smallest]} tets, at {where})")
    more = f"; and {len(broken) - 5} more" if len(broken) > 5 else ""
    cure = ("give each piece a group of its own, or make the pieces share faces" if kind == "groups" else
            f"use metis: {max(len(partition.names), pieces(faces, mesh.volume)[0])}, whose parts are always connected, or another count")
    raise InputError(Problem(PATH, f"disconnected subdomain: {'; '.join(shown)}{more}", "subdomains held together by shared faces", cure))
