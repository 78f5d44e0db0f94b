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
REMARK = (
    "the mesh is in partitions: each is a volume, and with subdomains: groups a subdomain; what "
    "joins two is an interface as all others")


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
    every = np.concatenate([file["points"] for file in read])
    tags, first, at = np.unique(np.concatenate([file["tags"] for file in read]), return_index=True,
                                return_inverse=True)
    if (every != every[first][at]).any():
        raise _strangers(paths[0], "nodes of one tag at different places")
    # name → kind of element → tags of elements; and kind → tags and nodes of all
    volumes, others, blocks = {}, {}, {}
    for file, told in zip(read, about):
        for i, (dimension, kind, number, names) in enumerate(told["blocks"]):
            rows = file[f"rows_{i}"]
            blocks.setdefault(kind, []).append(rows)
            for name in names or ["partition"]:
                named = volumes.setdefault((number, f"{name}_{number}"), {}) if dimension == 3 \
                    else others.setdefault(name, {})
                named.setdefault(kind, []).append(rows[:, 0])
    cells, known = [], {}
    for kind in sorted(blocks, key=common._gmsh_to_meshio_type.get):
        word, rows = common._gmsh_to_meshio_type[kind], np.concatenate(blocks[kind])
        known[kind], own = np.unique(rows[:, 0], return_index=True)
        nodes = common._gmsh_to_meshio_order(word, rows[own, 1:])
        cells.append(meshio.CellBlock(word, np.searchsorted(tags, nodes)))
    sets = {name: [np.unique(np.searchsorted(known[kind], np.concatenate(
        [np.empty(0, int), *members.get(kind, [])]))) for kind in known]
            for name, members in [*((name, own) for (_, name), own in sorted(volumes.items())),
                                  *sorted(others.items())]}
    surfaces = {name: np.array([0, 2]) for told in about for name in told["surfaces"]}
    return meshio.Mesh(every[first], cells, cell_sets=sets, field_data=surfaces,
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


def _strangers(path: Path, found: str) -> Exception:
    return bad_file(path, found, "all files of one mesh that gmsh has cut, and no other's",
                    "write them again, into an empty folder")
