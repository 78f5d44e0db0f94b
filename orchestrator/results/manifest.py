"""Manifest of the files that this program has written in a results folder: nothing else in it is
ever removed or replaced.

``.orchestrator/manifest`` has a line of JSON for each file, appended before the file gets its name:
whatever ends a run, its files are known. A line holds the file's size, time and hash, so that one
that somebody has changed since counts as theirs. Files that grow are claimed by a pattern of their
names instead, until they are done.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

OWN = ".orchestrator"  # the folder of what is for this program alone
NAME = f"{OWN}/manifest"
# the ending of files that are being written; nobody else's have it
UNFINISHED = ".orchestrator-part"
PARTS = "parts"  # in it a folder for each part that writes results of its own
FOLDERS = ("fields", "figures", "checkpoint", PARTS)
CHECKPOINT = r"checkpoint/(iteration-\d{6,}\.npz|reserve|problem\.json)"
# Names that a run writes under; programs that are parts have folders of their own beside.
RESULTS = (
    r"(summary\.json|(history|extremes|interfaces|probes|paths)\.csv|(fields|state)\.npz"
    r"|traceback\.txt"
           r"|fields/((step|interface)_\d{4,}\.vtu|(fields|interfaces)\.pvd)"
           r"|figures/(convergence|time|deformed|interfaces)\.png"
           rf"|{CHECKPOINT})")


class Manifest:
    """The files of a results folder that are this program's.

    folder : the results folder
    Raises OSError: from what writes, where it cannot
    """

    def __init__(self, folder: Path):
        self._folder, self._path = folder, folder / NAME

    def note(self, name: str, file: Path) -> None:
        """``file`` as it is now will be, or is, the one called ``name``."""
        self._append(self._line(name, file))

    def claim(self, pattern: str) -> None:
        """Claim files whose names match the regular expression as this program's until
        ``settled``.
        """
        if pattern not in self._read()[1]:
            self._append({"claimed": pattern})

    def settle(self, pattern: str) -> None:
        """Files that were claimed are done: those that are there are noted as they are."""
        if pattern in self._read()[1]:
            self._append(*(self._line(name, self._folder / name)
                           for name in self._names() if re.fullmatch(pattern, name)),
                         {"settled": pattern})

    def owned(self) -> Iterator[str]:
        """Names of the files that are there and this program's; of what links lead to, none."""
        known = self._read()
        return (name for name in self._names() if self._is_own(name, *known))

    def owns(self, name: str) -> bool:
        """Whether the file of this name is this program's."""
        return self._is_own(name, *self._read())

    def foreign(self, pattern: str) -> list[str]:
        """Files with names that match the regular expression and are not this program's."""
        known = self._read()
        return [name for name in self._names(links=True) if re.fullmatch(pattern, name)
                and not self._is_own(name, *known)]

    def clean(self) -> None:
        """Forget the files that are not there any more."""
        noted, claims = self._read()
        lines = [line for name, own in noted.items() if os.path.lexists(self._folder / name)
                 for line in own]
        lines += [{"claimed": claim} for claim in claims]
        with suppress(FileNotFoundError):
            self._path.unlink()
        self._append(*lines)

    def _names(self, links: bool = False) -> Iterator[str]:
        """Names of all that is where this program writes; ``links``: also in folders that links
        lead to.
        """
        for below in ("", *FOLDERS):
            if below and not links and (self._folder / below).is_symlink():
                continue
            for place, folders, files in os.walk(self._folder / below):
                if below != PARTS:
                    # a folder stands in the way of a file as well
                    yield from (os.path.join(below, name) for name in (*files, *folders))
                    break
                inside = os.path.relpath(place, self._folder)
                yield from (os.path.join(inside, name) for name in files)

    def _is_own(self, name: str, noted: dict[str, list[dict[str, Any]]], claims: list[str]) -> bool:
        """Whether a file is claimed, or one of those noted: by size and time, or where it was
        copied by size and content.
        """
        path = self._folder / name
        if not path.is_file() or path.is_symlink():
            return False
        if any(re.fullmatch(claim, name) for claim in claims):
            return True
        about = path.stat()
        alike = [line for line in noted.get(name, ()) if line.get("size") == about.st_size]
        hashes = {line.get("hash") for line in alike} - {None}
        return any(line.get("time") == about.st_mtime_ns for line in alike) or bool(
            hashes) and _hash(path) in hashes

    def _read(self) -> tuple[dict[str, list[dict[str, Any]]], list[str]]:
        """Lines of files by their names, and patterns that are claimed."""
        noted: dict[str, list[dict[str, Any]]] = {}
        claims: list[str] = []
        for line in self._lines():
            if "file" in line:
                noted.setdefault(line["file"], []).append(line)
            elif "claimed" in line:
                claims.append(line["claimed"])
            elif line.get("settled") in claims:
                claims.remove(line["settled"])
        return noted, claims

    def _lines(self) -> list[dict[str, Any]]:
        lines = []
        for text in self._path.read_bytes().splitlines() if self._path.exists() else ():
            with suppress(ValueError):  # half a line, of a process that was killed
                lines.append(json.loads(text))
        return [line for line in lines if isinstance(line, dict)]

    def _line(self, name: str, file: Path) -> dict[str, Any]:
        about = file.stat()
        return {"file": name, "size": about.st_size, "time": about.st_mtime_ns, "hash": _hash(file)}

    def _append(self, *lines: dict[str, Any]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        # each begins a line of its own, behind half a one of a process that was killed too
        content = b"".join(b"\n" + json.dumps(line).encode() for line in lines)
        with open(self._path, "ab", buffering=0) as file:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
            if content and file.write(content) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _hash(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
