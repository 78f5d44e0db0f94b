"""The files that a configuration names, and those that are read with them.

Any text of a configuration that is the path of a file names one: no key can be forgotten. Read with a file are what a
deck or a mesh in .inp includes, the pieces of a .pvtu, the data beside an .xdmf, what a form includes or loads, and the
modules that a Python file imports from beside it.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path
from typing import BinaryIO


def named(value: object) -> tuple[str | None, str]:
    """The file that a value of a configuration names, and what the value says beside; (None, "") where it names none.

    ``solver.py:Class`` names solver.py, ``package.module:Class`` the module's file, ``--table=file`` the file.
    """
    if not isinstance(value, str) or not value:
        return None, ""
    if os.path.isfile(value):
        return value, ""
    before, dot, after = value.partition(".py")
    if dot and os.path.isfile(f"{before}.py"):
        return f"{before}.py", after
    option, _, last = value.rpartition("=")
    if last and os.path.isfile(last):
        return last, f" of {option}"
    module, colon, name = value.partition(":")
    if colon and re.fullmatch(r"\w+(\.\w+)*", module) and name.isidentifier() and (file := _module(module)):
        return file, colon + name
    return None, ""


def included(file: str) -> list[str]:
    """The files that are read with a file, and with those, in the order in which they are met."""
    found, left = [], [os.path.abspath(file)]
    while left:
        path = left.pop(0)
        for other in _read_with(path, os.path.dirname(os.path.abspath(file))):
            if os.path.isfile(other) and other != os.path.abspath(file) and other not in found:
                found.append(other)
                left.append(other)
    return found


def hashed(file: str) -> str:
    """Hash of a file's content; of one that cannot be read, why: who reads it for good will tell."""
    try:
        with open(file, "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        return str(error.strerror)


def _read_with(path: str, root: str) -> Iterator[str]:
    """Paths that a file names as those of others, there or not; ``root``: the folder where the first file is."""
    suffix = os.path.splitext(path)[1].lower()
    try:
        with open(path, "rb") as file:
            text = b"" if suffix in _ALONE or b"\0" in file.read(_BINARY) else _whole(file)
    except OSError:
        return
    for pattern, others in _INCLUDES.get(suffix, _BY_WORDS):
        for match in pattern.finditer(text):
            for word in others(*(group.decode(errors="replace").strip() if group else "" for group in match.groups())):
                yield from (os.path.normpath(os.path.join(folder, word)) for folder in (os.path.dirname(path), root))


def _whole(file: BinaryIO) -> bytes:
    """All of it."""
    file.seek(0)
    return file.read()


def _modules(package: str, names: str) -> list[str]:
    """Files of ``from package import names`` or of ``import names``."""
    words = [part.split()[0].replace(".", "/") for part in names.replace("(", " ").split(",") if part.split()]
    place = package.lstrip(".").replace(".", "/")
    places = [os.path.join(place, word) for word in words] + [place] * bool(place)
    return [file for place in places for file in (f"{place}.py", f"{place}/__init__.py")]


def _pattern(text: str) -> re.Pattern[bytes]:
    return re.compile(text.encode(), re.IGNORECASE | re.MULTILINE)


_BINARY = 4096  # bytes in which binary files show that they are
_QUOTED = r"""[ \t]*["']([^"'\n]+)["']"""
_SELF = lambda word: [word]  # noqa: E731
_DATA = [(_pattern(r"([^\s<>\"']+\.h5)(?=:)"), _SELF)]
_INCLUDES = {
    ".pvtu": [(_pattern(rf"<Piece[^>]*\bSource[ \t]*={_QUOTED}"), _SELF)], ".xdmf": _DATA, ".xmf": _DATA,
    ".py": [(_pattern(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+)?import[ \t]+([^#\n]+)"), _modules)]}
# Decks and forms, whatever their ending.
_BY_WORDS = [(_pattern(r"^[ \t]*\*[ \t]*INCLUDE[ \t]*,[ \t]*INPUT[ \t]*=[ \t]*[\"']?([^,\"'\r\n]+)"), _SELF),
             (_pattern(rf"^[ \t]*(?:include|load){_QUOTED}"), lambda word: [word, f"{word}.so"])]
_ALONE = {".msh", ".vtu", ".vtk", ".mesh", ".stp", ".step", ".brep", ".mtx"}  # large texts that include nothing


def _module(name: str) -> str | None:
    """The file of a Python module, which is not imported."""
    place, file = None, None
    for part in name.split("."):
        spec = PathFinder.find_spec(part, place) or (PathFinder.find_spec(part, [os.getcwd()]) if place is None else None)
        if spec is None:
            return None
        file, place = spec.origin, spec.submodule_search_locations
    return file if file and Path(file).is_file() else None
