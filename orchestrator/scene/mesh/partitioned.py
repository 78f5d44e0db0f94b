"""gmsh's meshes in partitions (MSH 4.1), in one file or a file for each: read block by block, all of them or some of the partitions.

gmsh keeps the tags of nodes and elements in all files of a mesh. They tell what is the same, and give nodes and cells an order that
hangs neither on the number of files nor on who reads which.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from orchestrator.optional import Late
from orchestrator.scene.mesh.checks import bad_file

# not for who merely asks whether a file is in partitions
meshio, common, kinds = Late("meshio"), Late("meshio._common"), Late("meshio.gmsh.common")
REMARK = "the mesh is in partitions: each is a volume, and with subdomains: groups a subdomain; what joins two is an interface as all others"
TAG = "tag"  # of cells, among the data
SHORT, LONG, REAL = np.int32, np.int64, np.float64  # gmsh's int, size_t and double


class _CutShort(Exception):
    """The file ends, or goes on otherwise, where numbers should be."""


@dataclass(frozen=True)
class _Stream:
    """A file's numbers, in text or in bytes."""

    file: BinaryIO
    text: bool
    size: int

    def read(self, kind: type, count: int = 1) -> np.ndarray:
        """(count,) numbers."""
        width = 2 if self.text else np.dtype(kind).itemsize  # at least: a file may declare what it has not
        if not 0 <= count * width <= self.size - self.file.tell() + 1:
            raise _CutShort
        wide = float if kind is REAL else int
        found = (np.fromfile(self.file, wide, count, sep=" ") if self.text else np.fromfile(self.file, kind, count)) if count else np.empty(0)
        if len(found) < count:
            raise _CutShort
        return found.astype(wide, copy=False)

    def count(self) -> int:
        """One number, of how many things follow."""
        return int(self.read(LONG)[0])

    def pass_over(self, rows: int, width: int) -> None:
        """Some rows, each a line in text, or so many bytes."""
        if self.text:
            for _ in islice(self.file, rows):
                pass
        else:
            self.file.seek(rows * width, 1)


@dataclass
class Elements:
    """Of one kind, some partitions' alone.

    dimension, kind : 2 or 3, and meshio's word
    number, groups : their partition, and the names of their groups
    rows : (n, 1 + k) int, tags of each element and of its nodes
    """

    dimension: int
    kind: str
    number: int
    groups: list[str]
    rows: np.ndarray


@dataclass
class Partitioned:
    """One file.

    Raises InputError: it is of another version or cut short
    """

    path: Path
    _text: bool = True
    _names: dict[tuple[int, int], str] = field(default_factory=dict)  # of groups, by dimension and tag
    _entities: dict[tuple[int, int], tuple[list[int], list[int]]] = field(default_factory=dict)  # their partitions and groups
    _at: dict[str, int] = field(default_factory=dict)  # where sections begin

    def __post_init__(self) -> None:
        with self.path.open("rb") as file:
            try:
                while "Elements" not in self._at and (line := file.readline()):
                    if line.startswith(b"$") and not line.startswith(b"$End"):
                        self._begin(file, line.strip()[1:].decode(errors="replace"))
            except (_CutShort, ValueError):
                raise self._bad("cut short, or no file of gmsh's") from None
        if not {"PartitionedEntities", "Nodes", "Elements"} <= self._at.keys():
            raise self._bad("nodes, elements or partitions are missing")

    @property
    def partitions(self) -> frozenset[int]:
        """Numbers of those that the whole mesh has, be they in this file or another."""
        return frozenset(number for (dimension, _), (own, _) in self._entities.items() if dimension == 3 for number in own)

    @property
    def surfaces(self) -> list[str]:
        """Names of all surfaces of the mesh."""
        return [name for (dimension, _), name in self._names.items() if dimension == 2]

    def elements(self, wanted: Collection[int] | None = None) -> Iterator[Elements]:
        """Elements of volumes, and those of surfaces that are in groups, of some partitions; none: of all."""
        for stream, (dimension, tag), number, count in self._blocks("Elements"):
            kind = kinds._gmsh_to_meshio_type.get(number)
            if kind is None:
                raise self._bad(f"elements of gmsh's kind {number}", "elements that meshio knows")
            width, (own, groups) = 1 + common.num_nodes_per_cell[kind], self._entities.get((dimension, tag), ([], []))
            if dimension < 2 or dimension == 2 and not groups or not set(own if wanted is None else wanted) & set(own):
                stream.pass_over(count, LONG().itemsize * width)
                continue
            rows, word = stream.read(LONG, count * width).reshape(count, width), "surface" if dimension == 2 else "volume"
            named = [self._names.get((dimension, group), f"{word}_{group}") for group in groups]
            yield Elements(dimension, kind, own[0], named, np.column_stack([rows[:, 0], kinds._gmsh_to_meshio_order(kind, rows[:, 1:])]))

    def nodes(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of some nodes, by their tags (n,) int, ascending, are here; where (k, 3)."""
        at, points = [np.empty(0, int)], [np.empty((0, 3))]
        for stream, (dimension, _), parametric, count in self._blocks("Nodes"):
            tags = stream.read(LONG, count)
            values = stream.read(REAL, count * (3 + parametric * dimension)).reshape(count, 3 + parametric * dimension)
            place = np.minimum(np.searchsorted(wanted, tags), max(len(wanted) - 1, 0))
            own = wanted[place] == tags if len(wanted) else np.zeros(count, bool)
            at.append(place[own])
            points.append(values[own, :3])
        return np.concatenate(at), np.concatenate(points)

    def _blocks(self, section: str) -> Iterator[tuple[_Stream, tuple[int, int], int, int]]:
        """Each block's stream, to be read on, its entity, and the two numbers that follow in its head."""
        with self.path.open("rb") as file:
            file.seek(self._at[section])
            stream = self._stream(file)
            try:
                for _ in range(int(stream.read(LONG, 4)[0])):
                    dimension, tag, third = stream.read(SHORT, 3).tolist()
                    count = stream.count()
                    yield stream, (dimension, tag), third, count
            except _CutShort:
                raise self._bad(f"cut short in ${section}") from None

    def _begin(self, file: BinaryIO, section: str) -> None:
        """Reads, or passes over, a section."""
        self._at[section], stream = file.tell(), self._stream(file)
        if section == "MeshFormat":
            version, kind, size = file.readline().split()
            self._text = kind == b"0"
            if version != b"4.1" or size != b"8" or not self._text and np.fromfile(file, np.int32, 1)[0] != 1:
                raise self._bad("partitions in another version than 4.1, or in the bytes of another machine")
        elif section == "PhysicalNames":
            for _ in range(int(file.readline())):
                dimension, tag, name = shlex.split(file.readline().decode(errors="replace"))
                self._names[int(dimension), int(tag)] = name.strip()
        elif section == "PartitionedEntities":
            self._read_entities(stream)
        elif section == "Nodes":
            for inner, (dimension, _), parametric, count in self._blocks(section):
                inner.pass_over(count, LONG().itemsize)
                inner.pass_over(count, REAL().itemsize * (3 + parametric * dimension))
                end = inner.file.tell()
            file.seek(end)

    def _read_entities(self, stream: _Stream) -> None:
        _, ghosts = stream.read(LONG, 2).tolist()
        stream.read(SHORT, 2 * ghosts)
        for dimension, many in enumerate(stream.read(LONG, 4).tolist()):
            for _ in range(many):
                tag = int(stream.read(SHORT, 3)[0])
                own = stream.read(SHORT, stream.count()).tolist()
                stream.read(REAL, 3 if dimension == 0 else 6)
                groups = stream.read(SHORT, stream.count()).tolist()
                if dimension:
                    stream.read(SHORT, stream.count())
                self._entities[dimension, tag] = own, groups

    def _stream(self, file: BinaryIO) -> _Stream:
        return _Stream(file, self._text, self.path.stat().st_size)

    def _bad(self, found: str, expected: str = "a mesh that gmsh has written whole, in version 4.1") -> Exception:
        return bad_file(self.path, found, expected, "save the mesh again with gmsh; or without partitions")


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


def share_of(paths: Sequence[Path], share: int, shares: int) -> tuple[list[Partitioned], list[int] | None]:
    """One of equal shares of a mesh: some of several files, or some partitions of one file."""
    def own(things: list) -> list:
        return things[share * len(things) // shares : (share + 1) * len(things) // shares]

    if len(paths) > 1:
        return [Partitioned(path) for path in own(list(paths))], None
    file = Partitioned(paths[0])
    return [file], own(sorted(file.partitions))


def read_partitions(files: Sequence[Partitioned], wanted: Collection[int] | None = None) -> tuple[meshio.Mesh, np.ndarray]:
    """The mesh of some files, some partitions of it or all; nodes and cells in the order of their tags, and the tags of the nodes (n,) int.

    ``cell_data`` has those of the cells as ``TAG``. Volumes are called as their groups are, with the number of the partition; partition_1
    where there are no groups; surfaces as their groups. ``info`` has numbers and names of the volumes.

    Raises InputError: files of different meshes
    """
    found: dict[str, list[Elements]] = {}
    for file in files:
        for block in file.elements(wanted):
            found.setdefault(block.kind, []).append(block)
    volumes = sorted({(block.number, name) for own in found.values() for block in own if block.dimension == 3 for name in _names(block)})
    tags = np.unique(np.concatenate([np.empty(0, int), *(block.rows[:, 1:].ravel() for own in found.values() for block in own)]))
    points, cells, cell_tags, sets = _points(files, tags), [], [], {}
    for kind, own in sorted(found.items()):
        rows = np.concatenate([block.rows for block in own])
        known, first = np.unique(rows[:, 0], return_index=True)
        if len(known) < len(rows) and (rows[first][np.searchsorted(known, rows[:, 0])] != rows).any():
            raise strangers(files[0].path, "elements of one tag that are not the same")
        cells.append(meshio.CellBlock(kind, np.searchsorted(tags, rows[first, 1:])))
        cell_tags.append(known)
        for block in own:
            for name in _names(block):
                sets.setdefault(name, {}).setdefault(kind, []).append(np.searchsorted(known, block.rows[:, 0]))
    order = [name for _, name in volumes] + sorted(sets.keys() - {name for _, name in volumes})
    named = {name: [np.unique(np.concatenate(sets[name].get(block.type, [np.empty(0, int)]))) for block in cells] for name in order}
    surfaces = {name: np.array([0, 2]) for file in files for name in file.surfaces}
    info = {"remarks": [REMARK], "volumes": volumes}
    return meshio.Mesh(points, cells, cell_data={TAG: cell_tags}, cell_sets=named, field_data=surfaces, info=info), tags


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
