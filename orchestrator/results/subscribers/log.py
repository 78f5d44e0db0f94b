"""Files that grow record by record: what has been written stays readable whatever happens to the writer.

A file begins with a line of JSON that names format, version and problem; records follow:

    mark, lengths of header and payload, CRC-32 of both; header (JSON); payload (the arrays' bytes, one after the other)

A record that a killed process has not finished, or that a disk has damaged, fails its sums; it is left out, and so is
all that follows it.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

FORMAT, VERSION = "orchestrator checkpoint", 1
_HEAD = struct.Struct("<4sQQII")
_MARK = b"REC\n"


class OtherVersion(ValueError):
    """The file is of another version of the format."""


@dataclass(frozen=True)
class Record:
    """A record whose sums are right: its header, and where its arrays are."""

    path: Path
    header: dict[str, Any]
    offset: int

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays, read now."""
        result = {}
        with open(self.path, "rb") as file:
            file.seek(self.offset)
            for name, kind, shape in self.header["arrays"]:
                array = np.fromfile(file, np.dtype(kind), int(np.prod(shape)))
                result[name] = array.reshape(shape)
        return result


def begin(file: BinaryIO, problem: str) -> None:
    """The first line of a new file."""
    _write(file, (json.dumps({"format": FORMAT, "version": VERSION, "problem": problem}) + "\n").encode())


def append(file: BinaryIO, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write a record at the end of an unbuffered file; what cannot be written whole is taken back.

    Raises
    ------
    OSError : disk full …
    """
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    listed = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    text = json.dumps({**header, "arrays": listed}, default=lambda number: number.item()).encode()
    views = [memoryview(array).cast("B") for array in arrays.values() if array.size]
    total = 0
    for view in views:
        total = zlib.crc32(view, total)
    size = file.seek(0, 2)
    try:
        _write(file, _HEAD.pack(_MARK, len(text), sum(v.nbytes for v in views), zlib.crc32(text), total) + text)
        for view in views:
            _write(file, view)
    except BaseException:  # an interrupt too: nothing behind half a record can be read
        file.truncate(size)
        raise


def _write(file: BinaryIO, data: bytes | memoryview) -> None:
    data = memoryview(data)
    while data:
        data = data[file.write(data):]


def records(path: Path) -> Iterator[Record]:
    """The sound records of a file, in order, and its problem in ``header["problem"]``.

    Raises
    ------
    OtherVersion : the file is of another version
    ValueError : it is no such file
    """
    with open(path, "rb") as file:
        try:
            first = json.loads(file.readline())
            known, version, problem = first["format"] == FORMAT, first["version"], first["problem"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError("not the first line of a checkpoint") from error
        if not known:
            raise ValueError("another kind of file")
        if version != VERSION:
            raise OtherVersion(f"version {version}")
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            mark, header_size, size, header_sum, total = _HEAD.unpack(head)
            text = file.read(header_size) if mark == _MARK else b""
            if mark != _MARK or len(text) < header_size or zlib.crc32(text) != header_sum:
                return
            offset, left, summed = file.tell(), size, 0
            while left and (piece := file.read(min(left, 1 << 22))):
                summed, left = zlib.crc32(piece, summed), left - len(piece)
            if left or summed != total:
                return
            yield Record(path, {**json.loads(text), "problem": problem}, offset)


