"""gmsh's meshes in partitions, in one file or a file for each.

gmsh keeps the tags of nodes and elements in all files of a mesh. They tell what is the same, and
give nodes and cells an order that does not hang on the number of files.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from orchestrator.optional import Late
from orchestrator.scene.mesh.checks import bad_file
from orchestrator.scene.mesh.readers.libraries import by_gmsh

# not for who merely asks whether a file is in partitions
meshio, common = Late("meshio"), Late("meshio.gmsh.common")
REMARK = "the mesh is in partitions: each is a volume, and with subdomains: groups a subdomain; what joins two is an interface as all others"


def in_partitions(path: Path) -> list[Path]:
    """The files of a mesh in partitions that a path, or a pattern of several paths, stands for;
    none where it is in none.
    """
    files = [path] if path.is_file() else sorted(path.parent.glob(path.name))
    return files if files and all(file.suffix.lower() == ".msh" and _announced(file)
                                  for file in files) else []


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

    Raises InputError: files that gmsh cannot read, of different meshes, or some are missing
    """
    read = [_read(path) for path in paths]
    about = [json.loads(str(file["about"])) for file in read]
    _check_whole(about, paths[0])
    found: dict[int, list[tuple[list[str], np.ndarray]]] = {}
    volumes = set()
    for file, told in zip(read, about):
        for i, (dimension, kind, number, names) in enumerate(told["blocks"]):
            if dimension == 3:
                names = [f"{name}_{number}" for name in names or ["partition"]]
                volumes |= {(number, name) for name in names}
            found.setdefault(kind, []).append((names, file[f"rows_{i}"]))
    tags = np.unique(np.concatenate([rows[:, 1:].ravel()
                                     for own in found.values() for _, rows in own]))
    cells, sets = [], {}
    for kind, own in sorted(found.items(), key=lambda each: common._gmsh_to_meshio_type[each[0]]):
        word, rows = common._gmsh_to_meshio_type[kind], np.concatenate([rows for _, rows in own])
        known, first = np.unique(rows[:, 0], return_index=True)
        if (rows[first][np.searchsorted(known, rows[:, 0])] != rows).any():
            raise _strangers(paths[0], "elements of one tag that are not the same")
        nodes = common._gmsh_to_meshio_order(word, rows[first, 1:])
        cells.append(meshio.CellBlock(word, np.searchsorted(tags, nodes)))
        for names, theirs in own:
            for name in names:
                chosen = np.searchsorted(known, theirs[:, 0])
                sets.setdefault(name, {}).setdefault(word, []).append(chosen)
    order = [name for _, name in sorted(volumes)]
    order += sorted(sets.keys() - set(order))
    named = {name: [np.unique(np.concatenate(sets[name].get(block.type, [np.empty(0, int)])))
                    for block in cells] for name in order}
    surfaces = {name: np.array([0, 2]) for told in about for name in told["surfaces"]}
    return meshio.Mesh(_points(paths, read, tags), cells, cell_sets=named, field_data=surfaces,
                       info={"remarks": [REMARK]})


def _read(path: Path) -> dict[str, np.ndarray]:
    """Return what gmsh finds in a file, see ``child.by_parts``."""
    with by_gmsh(path, "mesh.npz", "a mesh that gmsh has written whole, in version 4.1",
                 "save the mesh again with gmsh; or without partitions") as made, \
            np.load(made) as found:
        return dict(found)


def _check_whole(about: Sequence[dict], path: Path) -> None:
    """Raise InputError where files of one mesh do not have all its partitions."""
    listed = about[0]["listed"]
    if any(told["listed"] != listed for told in about):
        raise _strangers(path, "files of meshes in different partitions")
    there = {number for told in about for dimension, _, number, _ in told["blocks"]
             if dimension == 3}
    if missing := sorted(set(listed) - there):
        raise _strangers(path, f"partition {missing[0]} of {len(listed)} is in none of the files")


def _points(paths: Sequence[Path], read: Sequence[dict[str, np.ndarray]],
            tags: np.ndarray) -> np.ndarray:
    """Return (n, 3) where the nodes of these tags are."""
    points = np.full((len(tags), 3), np.nan)
    for path, file in zip(paths, read):
        own = np.isin(file["tags"], tags)
        at, here = np.searchsorted(tags, file["tags"][own]), file["points"][own]
        before = points[at]
        if (~np.isnan(before) & (before != here)).any():
            raise _strangers(path, "nodes of one tag at different places")
        points[at] = here
    if len(lost := np.flatnonzero(np.isnan(points).any(axis=1))):
        raise _strangers(paths[0], f"node {tags[lost[0]]} is not there")
    return points


def _strangers(path: Path, found: str) -> Exception:
    return bad_file(path, found, "all files of one mesh that gmsh has cut, and no other's",
                    "write them again, into an empty folder")
