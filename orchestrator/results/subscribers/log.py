"""Files that grow record by record: what has been written stays readable whatever happens to the writer.

    mark, lengths of header and payload, CRC-32 of both, of the lengths; header (JSON); payload (the arrays' bytes, one after the other)

The header says of which version and problem a record is. One that a killed process has not finished, or that a disk has
damaged, fails its sums; it is left out, and so is all that follows it in its file.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

VERSION = 2
_HEAD = struct.Struct("<4sQQII")  # and the CRC-32 of these
_SUM = struct.Struct("<I")
_MARK = b"REC\n"
_FIRST_VERSION = b'{"format": "orchestrator checkpoint"'  # what files began with


class OtherVersion(ValueError):
    """The file is of another version of the format."""


class Damaged(ValueError):
    """The file is not as it was written, from some record on."""


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


def append(file: BinaryIO, problem: str, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write a record at the end of an unbuffered file; what cannot be written whole is taken back.

    Parameters
    ----------
    problem : fingerprint of the problem that it belongs to

    Raises
    ------
    OSError : disk full …
    """
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    listed = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    text = json.dumps({**header, "version": VERSION, "problem": problem, "arrays": listed},
                      default=lambda number: number.item()).encode()
    views = [memoryview(array).cast("B") for array in arrays.values() if array.size]
    total = 0
    for view in views:
        total = zlib.crc32(view, total)
    size = file.seek(0, 2)
    head = _HEAD.pack(_MARK, len(text), sum(v.nbytes for v in views), zlib.crc32(text), total)
    try:
        _write(file, head + _SUM.pack(zlib.crc32(head)) + text)
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
    """The sound records of a file, in order; what a killed process has not finished is left out.

    Raises
    ------
    OtherVersion : the file is of another version
    Damaged : what follows is not as it was written
    """
    with open(path, "rb") as file:
        end = os.fstat(file.fileno()).st_size
        while len(head := file.read(_HEAD.size + _SUM.size)) == _HEAD.size + _SUM.size:
            if head.startswith(_FIRST_VERSION[: len(head)]):
                raise OtherVersion("version 1")
            mark, header_size, size, header_sum, total = _HEAD.unpack(head[: _HEAD.size])
            if mark != _MARK or zlib.crc32(head[: _HEAD.size]) != _SUM.unpack(head[_HEAD.size:])[0]:
                raise Damaged(f"{path} at byte {file.tell() - len(head)}")
            if file.tell() + header_size + size > end:
                return
            text = file.read(header_size)
            if zlib.crc32(text) != header_sum:
                raise Damaged(f"{path} at byte {file.tell() - len(text)}")
            offset, left, summed = file.tell(), size, 0
            while left and (piece := file.read(min(left, 1 << 22))):
                summed, left = zlib.crc32(piece, summed), left - len(piece)
            if left or summed != total:
                raise Damaged(f"{path} at byte {offset}")
            header = json.loads(text)
            if header.get("version") != VERSION:
                raise OtherVersion(f"version {header.get('version')}")
            yield Record(path, header, offset)
