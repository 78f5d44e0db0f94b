"""Sizes that VTK's files declare, asked before VTK takes memory for them: it would end this program where there is none.

A compressed array begins with words of 4 or 8 bytes: the number of blocks, their size, that of the last one, what each takes in
the file. One that is not compressed begins with its size, which cannot be more than the file has.
"""

from __future__ import annotations

import base64
import mmap
import re
from collections.abc import Iterator
from pathlib import Path

from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.size import check_memory

# points and cells, in XML and in the older format
_SIZES = re.compile(rb"(?:NumberOf|\n)(Points|Cells|POINTS|CELLS)(?:\s*=\s*[\"']|[ \t]+)(\d{1,30})")
_HEAD = 1 << 12  # bytes in which the first element of the XML stands
_ARRAY = re.compile(rb"<(?:Data)?Array\b([^>]*)>\s*")
_APPENDED = re.compile(rb"<AppendedData\b([^>]*)>\s*_")


def check_room(path: Path) -> None:
    """Raises InputError where the sizes that a file declares do not fit in memory, or in the file."""
    if path.stat().st_size == 0:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        wanted = sum(int(n) * (24 if kind in (b"Points", b"POINTS") else 9) for kind, n in _SIZES.findall(text))
        head = re.search(rb"<VTKFile\b[^>]*>", text[:_HEAD])
        if head:
            order = "big" if _attribute(head[0], "byte_order") == b"BigEndian" else "little"
            width, compressed = 8 if _attribute(head[0], "header_type") == b"UInt64" else 4, _attribute(head[0], "compressor") is not None
            for start, coded in _arrays(text):
                words = _words(text, start, coded, width, 3 if compressed else 1, order)
                blocks, size, last = words if len(words) == 3 else (0, 0, 0)
                if (blocks * width if compressed else sum(words)) > len(text):
                    raise InputError(Problem(("mesh", "file"), f"{path}: the array at byte {start} declares more than the file has",
                                             "an unstructured grid as VTK writes it", "check the file: is it whole? save it again"))
                wanted += blocks * size + last
    check_memory(wanted, ("mesh", "file"), f"{path}, by the sizes that it declares", "check the file: are these its true sizes?")


def _attribute(element: bytes, name: str) -> bytes | None:
    found = re.search(rb"\b%s\s*=\s*[\"']\s*([^\"'\s]*)" % name.encode(), element)
    return found[1] if found else None


def _arrays(text: mmap.mmap) -> Iterator[tuple[int, bool]]:
    """Where binary arrays begin, and whether they are in base64."""
    appended = _APPENDED.search(text)
    for found in _ARRAY.finditer(text, 0, appended.start() if appended else len(text)):
        kind, offset = _attribute(found[1], "format"), _attribute(found[1], "offset") or b""
        if kind == b"binary":
            yield found.end(), True
        elif kind == b"appended" and appended and offset.isdigit():
            yield appended.end() + int(offset), _attribute(appended[1], "encoding") == b"base64"


def _words(text: mmap.mmap, start: int, coded: bool, width: int, count: int, order: str) -> list[int]:
    """The first words of an array; fewer where the text ends, or is no base64."""
    raw = text[start : start + (4 * -(-width * count // 3) if coded else width * count)]
    if coded:
        try:
            raw = base64.b64decode(raw)
        except ValueError:  # VTK complains
            return []
    return [int.from_bytes(raw[i : i + width], order) for i in range(0, min(len(raw) // width, count) * width, width)]  # type: ignore[arg-type]
