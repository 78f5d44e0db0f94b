"""Whether two runs solve the same problem: all that the method's state depends on, key by key, and
a hash of it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from glob import glob
from importlib.machinery import PathFinder
from pathlib import Path

import numpy as np

from orchestrator.kept import key_of

# When to stop, where to write, who computes and how long it may take change nothing in what a state
# means.
_FREE = {"name", "output", "blackbox.workers", "blackbox.transport", "blackbox.timeout",
         "parts.program.timeout", "method.tolerance", "method.max_iterations",
         "method.start"}
_SHORT = 40  # signs of a value in a message


def problem_of(config: Mapping[str, object], *arrays: np.ndarray) -> dict[str, str]:
    """The problem that a state depends on: key → value of the configuration (complete), key →
    content of the files that it names and
    of those that these include, and e.g. the mesh's nodes and cells.

    Tolerance, iteration limit, name, output, workers, transport and timeout are left out: a run may
    be resumed with others. So are the places of files: what is in them counts.
    """
    problem: dict[str, str] = {}
    for key, value in _leaves(config, ""):
        file, rest = named(value)
        if file is None:
            problem[key] = json.dumps(value, default=str)
            if key.endswith("mesh.file"):  # a pattern, of several files
                problem |= {f"{key}, {os.path.basename(other)}": f"content: {hashed(other)}"
                            for other in sorted(glob(value))}
            continue
        problem[key] = f"content of {os.path.basename(file)}{rest}: {hashed(file)}"
        for other in included(file):
            problem[f"{key}, with {os.path.relpath(other, os.path.dirname(file))}"] = (
                f"content: {hashed(other)}"
            )
    for number, array in enumerate(arrays):
        problem[("nodes of the mesh", "cells of the mesh")[number] if number < 2
                else f"array {number}"] = f"content: {key_of(array).hex()}"
    return problem


def digest_of(problem: Mapping[str, str]) -> str:
    """Hash of what ``problem_of`` has found."""
    return hashlib.sha256(json.dumps(problem, sort_keys=True).encode()).hexdigest()


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Say what differs between two problems; of the mesh only where nothing else explains it."""
    keys = [key for key in {**now, **before} if before.get(key) != now.get(key)]
    keys = [key for key in keys if not key.endswith(" of the mesh")] or keys
    told = []
    for key in keys:
        old, new = before.get(key), now.get(key)
        what = (new or old).rpartition(":")[0]
        told.append(f"{key}: {_shown(old)}, now {_shown(new)}" if "content" not in f"{old}{new}"
                    else
                    f"{key} ({what}) is another one" if what != "content"
                    else f"{key} is another one")
    return told


def _shown(value: str | None) -> str:
    return "nothing" if value is None else value if len(value) <= _SHORT else f"{value[:_SHORT]}…"


def _leaves(value: object, path: str) -> Iterator[tuple[str, object]]:
    """Keys with the places in lists, and what is no mapping or list; numbers of one list are one
    value.
    """
    if re.sub(r"\[\d+\]", "", path) in _FREE:
        return
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, (list, tuple)) and any(isinstance(item, (Mapping, list, tuple, str))
                                                  for item in value):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    else:
        yield path, value


def named(value: object) -> tuple[str | None, str]:
    """The file that a value of a configuration names, and what the value says beside; (None, "")
    where it names none.

    ``solver.py:Class`` names solver.py, ``package.module:Class`` the module's file,
    ``--table=file`` the file.
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
    if colon and re.fullmatch(r"\w+(\.\w+)*",
                              module) and name.isidentifier() and (file := _module(module)):
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
    """Hash of a file's content; of one that cannot be read, why: who reads it for good will
    tell.
    """
    try:
        with open(file, "rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        return str(error.strerror)


def _read_with(path: str, root: str) -> Iterator[str]:
    """Paths that a file names as those of others, there or not; ``root``: the folder where the
    first file is.
    """
    suffix = os.path.splitext(path)[1].lower()
    try:
        with open(path, "rb") as file:
            text = b"" if suffix in _ALONE or b"\0" in file.peek() else file.read()
    except OSError:
        return
    for pattern, others in _INCLUDES.get(suffix, _BY_WORDS):
        for match in pattern.finditer(text):
            for word in others(*(group.decode(errors="replace").strip() if group else ""
                                 for group in match.groups())):
                yield from (os.path.normpath(os.path.join(folder, word))
                            for folder in (os.path.dirname(path), root))


def _modules(package: str, names: str) -> list[str]:
    """Files of ``from package import names`` or of ``import names``."""
    words = [part.split()[0].replace(".", "/") for part in names.replace("(", " ").split(",")
             if part.split()]
    place = package.lstrip(".").replace(".", "/")
    places = [os.path.join(place, word) for word in words] + [place] * bool(place)
    return [file for place in places for file in (f"{place}.py", f"{place}/__init__.py")]


def _pattern(text: str) -> re.Pattern[bytes]:
    return re.compile(text.encode(), re.IGNORECASE | re.MULTILINE)


_QUOTED = r"""[ \t]*["']([^"'\n]+)["']"""
_SELF = lambda word: [word]  # noqa: E731
_DATA = [(_pattern(r"([^\s<>\"']+\.h5)(?=:)"), _SELF)]
_INCLUDES = {
    ".xdmf": _DATA, ".xmf": _DATA,
    ".py": [(_pattern(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+)?import[ \t]+([^#\n]+)"), _modules)]}
# Decks and forms, whatever their ending.
_BY_WORDS = [
    (_pattern(r"^[ \t]*\*[ \t]*INCLUDE[ \t]*,[ \t]*INPUT[ \t]*=[ \t]*[\"']?([^,\"'\r\n]+)"), _SELF),
             (_pattern(rf"^[ \t]*(?:include|load){_QUOTED}"), lambda word: [word, f"{word}.so"])]
# large texts that include nothing
_ALONE = {".msh", ".vtu", ".vtk", ".mesh", ".stp", ".step", ".brep", ".mtx"}


def _module(name: str) -> str | None:
    """The file of a Python module, which is not imported."""
    place, file = None, None
    for part in name.split("."):
        spec = PathFinder.find_spec(part, place) or (PathFinder.find_spec(part, [os.getcwd()])
                                                     if place is None else None)
        if spec is None:
            return None
        file, place = spec.origin, spec.submodule_search_locations
    return file if file and Path(file).is_file() else None
