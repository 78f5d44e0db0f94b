"""Files of one record each, a header and arrays: written whole or not at all, and read back as written or not at all.

    mark, length of the header, CRC-32 of all that follows; header (JSON); the arrays' bytes, one after the other
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

VERSION = 3
UNFINISHED = ".orchestrator-part"  # the ending of files that are being written; nobody else's have it
_HEAD, _MARK = struct.Struct("<4sQI"), b"RECD"
_EARLIER = (b"REC\n", b'{"format": "orchestrator checkpoint"')  # what files of versions 2 and 1 begin with


class OtherVersion(ValueError):
    """The file is of another version of the format."""


class Damaged(ValueError):
    """The file is not as it was written."""


@dataclass(frozen=True)
class Record:
    """What a file holds."""

    header: dict[str, Any]
    arrays: dict[str, np.ndarray]


def write_record(path: Path, problem: str, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray], sync: bool = False) -> None:
    """Replace a file.

    Parameters
    ----------
    problem : fingerprint of the problem that it belongs to
    sync : whether the disk itself is waited for

    Raises
    ------
    OSError : disk full …
    """
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    listed = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    text = json.dumps({**header, "version": VERSION, "problem": problem, "arrays": listed}, default=lambda number: number.item()).encode()
    pieces = [text, *(memoryview(array).cast("B") for array in arrays.values() if array.size)]
    total = 0
    for piece in pieces:
        total = zlib.crc32(piece, total)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}{UNFINISHED}")
    temporary.unlink(missing_ok=True)  # nothing is written through a link
    try:
        with open(temporary, "wb") as file:
            file.writelines([_HEAD.pack(_MARK, len(text), total), *pieces])
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_record(path: Path) -> Record:
    """Read a file.

    Raises
    ------
    OSError : it cannot be read
    OtherVersion : it is of another version
    Damaged : it is not as it was written
    """
    content = path.read_bytes()
    if content.startswith(_EARLIER):
        raise OtherVersion(f"version {2 if content.startswith(_EARLIER[0]) else 1}")
    body = memoryview(content)[_HEAD.size:]
    if len(content) < _HEAD.size or (head := _HEAD.unpack_from(content))[0] != _MARK or head[1] > len(body) or head[2] != zlib.crc32(body):
        raise Damaged(str(path))
    try:
        header = json.loads(bytes(body[: head[1]]))
        if header["version"] != VERSION:
            raise OtherVersion(f"version {header['version']}")
        arrays, at = {}, head[1]
        for name, kind, shape in header["arrays"]:
            array = np.frombuffer(body, np.dtype(kind), int(np.prod(shape)), at)
            arrays[name], at = array.reshape(shape).copy(), at + array.nbytes
    except (KeyError, TypeError, ValueError) as error:  # a bit of the header's length
        if isinstance(error, OtherVersion):
            raise
        raise Damaged(str(path)) from error
    return Record(header, arrays)
