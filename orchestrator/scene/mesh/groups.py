"""Groups of the cells in a file that meshio has read: of every format by one kind of name, and as volumes that share no cell."""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np

# Where the formats keep the number of each cell's group, the most telling first.
TAGS = ("gmsh:physical", "medit:ref", "gmsh:geometrical", "avsucd:material", "flac3d:group", "tetgen:ref", "netgen:index")

# Numbers of nodes up to so many times their count, and so many more, cost little.
FAR, FEW = 10, 1_000_000


def cells_of(raw: meshio.Mesh, kind: str, dimension: int, word: str) -> tuple[np.ndarray, dict, str]:
    """All cells of a kind, their groups (name → indices), and a name for those in no group."""
    blocks = [i for i, block in enumerate(raw.cells) if block.type == kind]
    if not blocks:
        return np.empty((0, 3), dtype=int), {}, ""
    cells = np.concatenate([np.asarray(raw.cells[i].data, dtype=np.int64) for i in blocks])
    starts = np.cumsum([0, *(len(raw.cells[i].data) for i in blocks)])
    groups: dict[str, list[np.ndarray]] = {}
    for name, sets in raw.cell_sets.items():
        index = [start + np.asarray(sets[i], dtype=np.int64) for i, start in zip(blocks, starts) if sets[i] is not None and len(sets[i])]
        if index and not name.startswith("gmsh:"):
            groups.setdefault(name, []).extend(index)
    known = {numbers: name for name, numbers in physical_names(raw)}
    for key in TAGS:
        if key not in raw.cell_data:
            continue
        tags = np.concatenate([np.ravel(raw.cell_data[key][i]).astype(np.int64) for i in blocks])
        for tag in np.unique(tags[tags != 0]):
            name = known.get((int(tag), dimension), f"{word}_{tag}") if key == "gmsh:physical" else f"{word}_{tag}"
            groups.setdefault(name, []).append(np.flatnonzero(tags == tag))
        if tags.any():
            break
    if {"gmsh:geometrical", "gmsh:physical"} <= raw.cell_data.keys():
        pairs = np.unique(np.column_stack([np.concatenate([np.ravel(raw.cell_data[key][i]) for i in blocks])
                                           for key in ("gmsh:geometrical", "gmsh:physical")]), axis=0)
        if len(pairs) > len(np.unique(pairs[:, 0])):  # gmsh's older files (2.2) have an element in two groups twice, once for each
            _, first, back = np.unique(np.sort(cells, axis=1), axis=0, return_index=True, return_inverse=True)
            cells, groups = cells[first], {name: [back.ravel()[i] for i in index] for name, index in groups.items()}
    return cells, {name: np.unique(np.concatenate(index)) for name, index in groups.items()}, f"{word}_0" if groups else f"{word}_1"


def volumes_of(groups: dict[str, np.ndarray], size: int, rest: str) -> tuple[list[str], np.ndarray, list[str]]:
    """One volume per cell: the smallest of the groups that hold it, so that sets of sets do not hide parts; what to say of it."""
    volume, names, said, shared = np.full(size, -1), list(groups), [], []
    for i in sorted(range(len(names)), key=lambda i: -len(groups[names[i]])):
        volume[groups[names[i]]] = i
    for i, name in enumerate(names):
        owners, counts = np.unique(volume[groups[name]], return_counts=True)
        lost = [j for j in owners if j != i]
        # Two names for the same tets are no riddle.
        if lost and not (len(owners) == 1 and len(groups[names[lost[0]]]) == len(groups[name])):
            kept = len(groups[name]) - counts[owners != i].sum()
            shared.append(f"of '{name}' {kept:,} of {len(groups[name]):,} are left, the others are in "
                          + ", ".join(f"'{names[j]}'" for j in lost[:3]) + (", …" if len(lost) > 3 else ""))
    if shared:
        said.append("tetrahedra in several groups belong to the smallest of them: " + "; ".join(shared[:5])
                    + (f"; and so on for {len(shared) - 5} more" if len(shared) > 5 else "")
                    + ". A group that keeps none names no volume: name those that have its tetrahedra")
    if (volume < 0).any():
        if groups:
            said.append(f"{(volume < 0).sum():,} of {size:,} tetrahedra are in no group of the file: they are '{rest}'")
        volume[volume < 0] = len(names)
        names.append(rest)
    used, volume = np.unique(volume, return_inverse=True)
    return [names[i] for i in used], volume, said


def physical_names(raw: meshio.Mesh) -> list[tuple[str, tuple[int, int]]]:
    """gmsh's physical names, each with its tag and dimension; one name may be there in several
    dimensions, see ``named_groups``."""
    return [(name, tuple(map(int, pair))) for name, value in raw.field_data.items() if np.size(value) >= 2
            for pair in np.reshape(value, (-1, 2))]


def named_groups(path: Path) -> dict[str, np.ndarray]:
    """Return (k, 2) tags and dimensions of each physical name of a gmsh file: meshio keeps the
    last dimension of a name alone."""
    found: dict[str, list[list[int]]] = {}
    with path.open("rb") as file:
        for line in file:
            if line.startswith((b"$Nodes", b"$Elements", b"$Entities", b"$EndPhysicalNames")):
                break
            if group := re.match(rb'\s*(\d+)\s+(\d+)\s+"(.*)"', line):
                name = group[3].decode(errors="replace")
                found.setdefault(name, []).append([int(group[2]), int(group[1])])
    return {name: np.array(pairs) for name, pairs in found.items()}


def far_apart(path: Path) -> bool:
    """Return whether the largest number of a node in a gmsh file is far beyond their count:
    meshio keeps an array as long as that."""
    with path.open("rb") as file:
        head, _, rest = file.read().partition(b"$Nodes")
    version, kind = (re.search(rb"\$MeshFormat\s+(\S+)\s+(\d)", head) or re.match(b"()()", b"")).groups()
    rest = rest[rest.find(b"\n") + 1 :]
    if version == b"4.1":
        counts = np.frombuffer(rest[:32], np.uint64) if kind == b"1" else rest.split(None, 4)[:4]
        _, count, _, largest = map(int, counts)
        return bool(largest > FAR * count + FEW)
    if not version.startswith(b"2"):
        return False
    line, _, table = rest.partition(b"\n")
    count = int(line)
    if kind == b"1":
        numbers = np.frombuffer(table, np.dtype([("id", "i4"), ("x", "f8", 3)]), count)["id"]
    else:
        numbers = np.array(table.split(None, 4 * count)[: 4 * count : 4], dtype=np.int64)
    return bool(numbers.max(initial=0) > FAR * count + FEW)
