"""Mesh files: the reader of a format, and the mesh of what it gives; groups are kept by name.

A reader takes a path and returns the mesh as meshio has it, with linear or quadratic cells of any
shape, groups as cell sets or tags. Of quadratic cells the corners are kept, and edges that bend
become straight: said, with how far. ``registry.READERS`` has one line for each ending.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.registry import READERS
from orchestrator.scene.mesh.checks import bad_file, check_memory
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.readers.partitioned import in_partitions, read_all
from orchestrator.scene.mesh.readers.splitting import in_tets, straightened

ROOM = 2.0  # bytes that reading takes per byte of the file, at least
FLAT_CELLS = {"vertex", "line", "line3", "triangle", "quad"}


def file(mesh: Any) -> Mesh:
    """The mesh file named by ``mesh.file``."""
    return read(Path(mesh.file))


def read(path: Path) -> Mesh:
    """Reads tets and named groups; nodes that no tet uses are dropped.

    Volumes are named by gmsh's physical names or the format's cell sets, else ``volume_<tag>``;
    surfaces likewise, else ``surface_<tag>``. A named surface none of whose triangles lies on tets
    is there, empty.
    Raises InputError: no such file, too large, unreadable, no solid cells, of higher order, too
    distorted to be split
    """
    loaded = _load(path)
    raw, remarks = straightened(loaded)
    raw, split = in_tets(raw, str(path))
    _check_kinds(path, {block.type for block in raw.cells})
    cells, groups, rest = cells_of(raw, "tetra", 3, "volume")
    volumes, volume, unclear = volumes_of(groups, len(cells), rest)
    if lost := [name for name, (_, dimension) in physical_names(raw) if dimension == 3
                and name not in groups]:
        unclear.append("named in the file, with no elements: "
                       + ", ".join(f"'{name}'" for name in lost[:5])
                       + (", …" if len(lost) > 5 else "")
                       + "; gmsh's version 2.2 with Mesh.SaveAll = 1 forgets the groups, 4.1 keeps "
                       "them")
    triangles, surfaces, _ = cells_of(raw, "triangle", 2, "surface")
    used, cells = renumbered(cells)
    renumber = np.full(len(raw.points), -1)
    renumber[used] = np.arange(len(used))
    named = {name: renumber[triangles[index]] for name, index in surfaces.items()}
    # Triangles away from the tets (shells, helper geometry) are no faces of theirs.
    named = {name: rows[(rows >= 0).all(axis=1)] for name, rows in named.items()}
    for name, (_, dimension) in physical_names(raw):
        if dimension == 2:
            named.setdefault(name, np.empty((0, 3), np.int64))
    return Mesh(np.asarray(raw.points, float)[used], cells, volume, volumes,
                named, str(path), remarks=[
        *(loaded.info or {}).get("remarks", []), *remarks, *split, *unclear])


def _check_kinds(path: Path, kinds: set[str]) -> None:
    """Raises InputError where solid cells are not tets, all of them, or there are none."""
    solid = sorted(kinds - FLAT_CELLS)
    if any(kind.startswith("tetra") and kind != "tetra" for kind in solid):
        problem = (f"tetrahedra of higher order ({', '.join(solid)})",
                   "four- or ten-node tetrahedra",
                   "save the mesh with linear elements (gmsh: -order 1) and write blackbox: "
                   "{element: P2}: the nodes amid the edges are put back here")
    elif not solid:
        problem = (f"no tetrahedra (it has {', '.join(sorted(kinds)) or 'no cells at all'})",
                   "four-node tetrahedra",
                   "mesh the volume, not only its surface, and save the volume elements")
    elif solid != ["tetra"]:
        problem = (
            "cells that are not known here: "
            f"{', '.join(kind for kind in solid if kind != 'tetra')}",
                   "tetrahedra, hexahedra, prisms or pyramids, linear or quadratic",
            "mesh the volume with tetrahedra")
    else:
        return
    raise bad_file(path, *problem)


def _load(path: Path) -> meshio.Mesh:
    """Read a file with the reader of its ending."""
    if parts := in_partitions(path):
        check_memory(ROOM * sum(part.stat().st_size for part in parts), ("mesh", "file"),
                     str(parts[0]), "use a coarser mesh")
        return read_all(parts)
    if not path.is_file():
        raise bad_file(path, "no such file", "an existing mesh file", "check the path")
    check_memory(ROOM * path.stat().st_size, ("mesh", "file"), str(path),
                 "use a coarser mesh, or save it in a binary format")
    return READERS[path.suffix.lower()](path)


# Where the formats keep the number of each cell's group, the most telling first.
TAGS = ("gmsh:physical", "medit:ref", "gmsh:geometrical", "avsucd:material", "flac3d:group",
        "tetgen:ref", "netgen:index")


def cells_of(raw: meshio.Mesh, kind: str, dimension: int,
             word: str) -> tuple[np.ndarray, dict, str]:
    """All cells of a kind, their groups (name → indices), and a name for those in no group."""
    blocks = [i for i, block in enumerate(raw.cells) if block.type == kind]
    if not blocks:
        return np.empty((0, 3), int), {}, ""
    cells = np.concatenate([np.asarray(raw.cells[i].data, np.int64) for i in blocks])
    starts = np.cumsum([0, *(len(raw.cells[i].data) for i in blocks)])
    groups: dict[str, list[np.ndarray]] = {}
    for name, sets in raw.cell_sets.items():
        index = [start + np.asarray(sets[i], np.int64) for i, start in zip(blocks, starts)
                 if sets[i] is not None and len(sets[i])]
        if index and not name.startswith("gmsh:"):
            groups.setdefault(name, []).extend(index)
    known = {numbers: name for name, numbers in physical_names(raw)}
    told = {key: np.concatenate([np.ravel(raw.cell_data[key][i]).astype(np.int64) for i in blocks])
            for key in TAGS if key in raw.cell_data}
    if key := next((key for key, tags in told.items() if tags.any()), None):
        for tag in np.unique(told[key][told[key] != 0]):
            name = known.get((int(tag), dimension) if key == "gmsh:physical" else None,
                             f"{word}_{tag}")
            groups.setdefault(name, []).append(np.flatnonzero(told[key] == tag))
    if {"gmsh:geometrical", "gmsh:physical"} <= told.keys():
        pairs = np.unique(np.column_stack([told[key] for key in (
            "gmsh:geometrical", "gmsh:physical")]), axis=0)
        # gmsh's older files (2.2) have an element in two groups twice, once for each
        if len(pairs) > len(np.unique(pairs[:, 0])):
            _, first, back = np.unique(np.sort(cells, axis=1), axis=0, return_index=True,
                                       return_inverse=True)
            cells, groups = cells[first], {name: [back.ravel()[i] for i in index]
                                           for name, index in groups.items()}
    return cells, {name: np.unique(np.concatenate(index))
                   for name, index in groups.items()}, f"{word}_0" if groups else f"{word}_1"


def volumes_of(groups: dict[str, np.ndarray], size: int,
               rest: str) -> tuple[list[str], np.ndarray, list[str]]:
    """One volume per cell: the smallest of the groups that hold it, so that sets of sets do not
    hide parts; what to say of it.
    """
    volume, names, said, shared = np.full(size, -1), list(groups), [], []
    for i in sorted(range(len(names)), key=lambda i: -len(groups[names[i]])):
        volume[groups[names[i]]] = i
    for i, name in enumerate(names):
        owners, counts = np.unique(volume[groups[name]], return_counts=True)
        lost = [j for j in owners if j != i]
        # Two names for the same tets are no riddle.
        if lost and not (len(owners) == 1 and len(groups[names[lost[0]]]) == len(groups[name])):
            kept = len(groups[name]) - counts[owners != i].sum()
            shared.append(
                f"of '{name}' {kept:,} of {len(groups[name]):,} are left, the others are in "
                          + ", ".join(f"'{names[j]}'" for j in lost[:3])
                + (", …" if len(lost) > 3 else ""))
    if shared:
        said.append("tetrahedra in several groups belong to the smallest of them: "
                    + "; ".join(shared[:5])
                    + (f"; and so on for {len(shared) - 5} more" if len(shared) > 5 else "")
                    + ". A group that keeps none names no volume: name those that have its "
                    "tetrahedra")
    if (volume < 0).any():
        if groups:
            said.append(
                f"{(volume < 0).sum():,} of {size:,} tetrahedra are in no group of the file: they "
                f"are '{rest}'")
        volume[volume < 0] = len(names)
        names.append(rest)
    used, volume = np.unique(volume, return_inverse=True)
    return [names[i] for i in used], volume, said


def physical_names(raw: meshio.Mesh) -> list[tuple[str, tuple[int, int]]]:
    """gmsh's physical names, each with its tag and dimension; one name may be there in several
    dimensions, see ``libraries.named_groups``."""
    return [(name, tuple(map(int, pair))) for name, value in raw.field_data.items()
            if np.size(value) >= 2
            for pair in np.reshape(value, (-1, 2))]
