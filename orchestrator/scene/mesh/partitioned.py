"""gmsh's meshes in partitions, in one file or a file for each.

gmsh keeps the tags of nodes and elements in all files of a mesh. They tell what is the same, and give nodes and cells an order that
hangs neither on the number of files nor on who reads which.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from orchestrator.optional import Late
from orchestrator.scene.mesh.checks import bad_file
from orchestrator.scene.mesh.msh import Elements, Partitioned

meshio = Late("meshio")  # not for who merely asks whether a file is in partitions
REMARK = "the mesh is in partitions: each is a volume, and with subdomains: groups a subdomain; what joins two is an interface as all others"


def in_partitions(path: Path) -> list[Path]:
    """The files of a mesh in partitions that a path, or a pattern of several paths, stands for; none where it is in none."""
    files = [path] if path.is_file() else sorted(path.parent.glob(path.name))
    return files if files and all(file.suffix.lower() == ".msh" and _announced(file) for file in files) else []


def _announced(path: Path) -> bool:
    """Whether a file has partitions: told before nodes and elements."""
    with path.open("rb") as file:
        for line in file:
            if line.startswith((b"$Nodes", b"$Elements")):
                return False
            if line.startswith(b"$PartitionedEntities"):
                return True
    return False


def read_all(paths: Sequence[Path]) -> meshio.Mesh:
    """Return the mesh of all files, nodes and cells in the order of their tags.

    Volumes are called as their groups are, with the number of the partition; partition_1 where
    there are no groups; surfaces as their groups.

    Raises InputError: files of different meshes, or some are missing
    """
    files = [Partitioned(path) for path in paths]
    found: dict[str, list[Elements]] = {}
    for file in files:
        for block in file.elements():
            found.setdefault(block.kind, []).append(block)
    volumes = sorted({(block.number, name) for own in found.values() for block in own if block.dimension == 3 for name in _names(block)})
    tags = np.unique(np.concatenate([np.empty(0, int), *(block.rows[:, 1:].ravel() for own in found.values() for block in own)]))
    points, cells, sets = _points(files, tags), [], {}
    for kind, own in sorted(found.items()):
        rows = np.concatenate([block.rows for block in own])
        known, first = np.unique(rows[:, 0], return_index=True)
        if len(known) < len(rows) and (rows[first][np.searchsorted(known, rows[:, 0])] != rows).any():
            raise strangers(files[0].path, "elements of one tag that are not the same")
        cells.append(meshio.CellBlock(kind, np.searchsorted(tags, rows[first, 1:])))
        for block in own:
            for name in _names(block):
                sets.setdefault(name, {}).setdefault(kind, []).append(np.searchsorted(known, block.rows[:, 0]))
    order = [name for _, name in volumes] + sorted(sets.keys() - {name for _, name in volumes})
    named = {name: [np.unique(np.concatenate(sets[name].get(block.type, [np.empty(0, int)]))) for block in cells] for name in order}
    surfaces = {name: np.array([0, 2]) for file in files for name in file.surfaces}
    check_whole([file.partitions for file in files], {number for number, _ in volumes}, paths[0])
    return meshio.Mesh(points, cells, cell_sets=named, field_data=surfaces, info={"remarks": [REMARK]})


def _names(block: Elements) -> list[str]:
    """Of its surfaces or volumes."""
    return block.groups if block.dimension == 2 else [f"{name}_{block.number}" for name in block.groups or ["partition"]]


def check_whole(listed: Collection[frozenset[int]], found: Collection[int], path: Path) -> None:
    """Raises InputError where files of one mesh do not have all its partitions.

    listed : of each file, numbers of those that it says the mesh has; found : of those that are in any
    """
    if len(set(listed)) > 1:
        raise strangers(path, "files of meshes in different partitions")
    if missing := sorted(set().union(*listed) - set(found)):
        raise strangers(path, f"partition {missing[0]} of {len(set().union(*listed))} is in none of the files")


def _points(files: Sequence[Partitioned], tags: np.ndarray) -> np.ndarray:
    """(n, 3) where the nodes of these tags are."""
    points = np.full((len(tags), 3), np.nan)
    for file in files:
        at, here = file.nodes(tags)
        before = points[at]
        if (~np.isnan(before) & (before != here)).any():
            raise strangers(file.path, "nodes of one tag at different places")
        points[at] = here
    if len(lost := np.flatnonzero(np.isnan(points).any(axis=1))):
        raise strangers(files[0].path, f"node {tags[lost[0]]} is not there")
    return points


def strangers(path: Path, found: str) -> Exception:
    return bad_file(path, found, "all files of one mesh that gmsh has cut, and no other's", "write them again, into an empty folder")
