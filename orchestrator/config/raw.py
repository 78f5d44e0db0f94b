"""What is done to the raw data before it is validated: ``--set a.b.c=value``, and files looked up beside the YAML file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from orchestrator.config.blackbox import settings_class
from orchestrator.config.parts import file_keys
from orchestrator.config.paths import get, matches
from orchestrator.config.rules import ONE_OF
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import IN_VOLUMES

# An override that picks one alternative removes the others, and what belongs to them alone.
# Two mesh sources stay an error: a mesh decides what all other entries mean.
ALTERNATIVES: list[tuple[KeyPath, list[set[str]]]] = [
    (("method", "tolerance"), [{key} for key in ONE_OF["method", "tolerance"]]),
    (("subdomains",), [{"slices"}, {"grid"}, {"metis"}, {"groups", "split_above"}]),
    (("boundary", "*"), [{key} for key in ONE_OF["boundary", "*"]]),
    (("boundary", "*", "on"), [{"plane", "at"}, {"box"}]),
]
SHIPPED = "gmsh:"  # models that come with gmsh; the scene knows where they are


class BadOverride(Exception):
    """An override that cannot be applied; ``problem`` says why."""

    def __init__(self, path: KeyPath, found: str, expected: str, cure: str):
        self.problem = Problem(path, found, expected, cure)
        super().__init__(found)


def parse(text: str, parse_value: Callable[[str], Any]) -> tuple[KeyPath, Any]:
    """``"materials.0.young=1"`` → ``(("materials", 0, "young"), 1)``; raises BadOverride without a ``=``, or with an empty key."""
    keys, equals, value = text.partition("=")
    parts = [key.strip() for key in keys.split(".")]
    if not equals or not all(parts):
        raise BadOverride((), text, "key=value, such as method.max_iterations=100", "write the key, =, and the value")
    return tuple(int(key) if key.isdigit() else key for key in parts), parse_value(value)


def apply(data: Any, path: KeyPath, value: Any, at: KeyPath = ()) -> Any:
    """The data with the value at a path replaced or added; mappings on the way are created.

    Raises BadOverride for an index outside a list, or a name where a list is.
    """
    if not path:
        return value
    key, here = path[0], (*at, path[0])
    if isinstance(data, list):
        if not isinstance(key, int) or key >= len(data):
            raise BadOverride(here, f"'{key}' in a list of {len(data)} entries", f"an index from 0 to {len(data) - 1}",
                              "take an existing entry; new ones belong in the file")
        return [apply(entry, path[1:], value, here) if index == key else entry for index, entry in enumerate(data)]
    key = str(key)
    kept = data if isinstance(data, dict) else {}
    for pattern, known in ALTERNATIVES:
        if matches(at, pattern) and (chosen := next((names for names in known if key in names), None)):
            removed = set().union(*known) - chosen
            kept = {name: entry for name, entry in kept.items() if name not in removed}
    return {**kept, key: apply(kept.get(key), path[1:], value, here)}


def with_files(data: Any, folder: Path) -> tuple[Any, list[Problem]]:
    """The data with files looked up beside the YAML file first, then in the current folder; problems of those not there."""
    problems: list[Problem] = []

    def found(name: Any, path: KeyPath) -> Any:
        """A file's path, or a list of such; what is no name is left as it is."""
        if isinstance(name, list):
            return [found(one, (*path, i)) for i, one in enumerate(name)]
        if not isinstance(name, str) or not name or path[-2:] == ("mesh", "step") and name.startswith(SHIPPED):
            return name
        places = [os.path.normpath(folder / name), os.path.normpath(name)]
        there = next((place for place in places if os.path.isfile(place)), None)
        if there is None:
            problems.append(Problem(path, f"no file {' nor '.join(dict.fromkeys(places))}",
                                    "an existing file", "paths are relative to the YAML file's folder"))
        return there or name

    def looked_up(path: KeyPath) -> None:
        nonlocal data
        if (name := get(data, *path)) is not None:
            data = apply(data, path, found(name, path))

    parts, loads = get(data, "parts"), get(data, "loads")
    for mesh in [("mesh",), *(("parts", i, "mesh") for i in range(len(parts) if isinstance(parts, list) else 0))]:
        for key in ("file", "step"):
            looked_up((*mesh, key))
    for i, part in enumerate(parts if isinstance(parts, list) else []):
        for kind, key in file_keys(part) if isinstance(part, dict) else ():
            looked_up(("parts", i, kind, key))
    for i in range(len(loads) if isinstance(loads, list) else 0):
        for name, kind in IN_VOLUMES.items():
            for key in kind.files:
                looked_up(("loads", i, name, key))
    entry = get(data, "blackbox")
    if entry is not None:  # a code knows which of its keys name files
        own = [settings_class(e).beside(e, folder) if isinstance(e, dict) else e for e in (entry if isinstance(entry, list) else [entry])]
        data = {**data, "blackbox": own if isinstance(entry, list) else own[0]}
    return data, problems

