"""One file of a mesh that gmsh has cut into partitions (MSH 4.1), read block by block."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np

from orchestrator.optional import Late
from orchestrator.scene.mesh.checks import bad_file

common, kinds = Late("meshio._common"), Late("meshio.gmsh.common")
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
    """Of one kind, of one partition.

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

    def elements(self) -> Iterator[Elements]:
        """Yield elements of volumes, and those of surfaces that are in groups."""
        for stream, (dimension, tag), number, count in self._blocks("Elements"):
            kind = kinds._gmsh_to_meshio_type.get(number)
            if kind is None:
                raise self._bad(f"elements of gmsh's kind {number}", "elements that meshio knows")
            width, (own, groups) = 1 + common.num_nodes_per_cell[kind], self._entities.get((dimension, tag), ([], []))
            if dimension < 2 or dimension == 2 and not groups or not own:
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
