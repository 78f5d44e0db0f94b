"""The raw data of a YAML file, whatever shape it has: looked up, changed by ``--set``, files in it
found; and how values are written
in messages."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from glob import glob
from pathlib import Path
from typing import Any

from orchestrator.config.blackbox import settings_class
from orchestrator.config.mesh import KINDS
from orchestrator.errors import KeyPath, Problem, dotted, wrong
from orchestrator.registry import DEFAULT_LAW, IN_VOLUMES, LAWS, ON_FACES


def find(data: Any, pattern: KeyPath, at: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """All (path, value) that match a pattern; ``"*"`` stands for every entry of a list.

    Absent and null values are skipped, as are places whose shape does not fit.

    >>> list(find({"a": [{"b": 1}, {"b": 2}]}, ("a", "*", "b")))
    [(('a', 0, 'b'), 1), (('a', 1, 'b'), 2)]
    """
    if data is None:
        return
    if not pattern:
        yield at, data
        return
    key, *rest = pattern
    if isinstance(data, dict) and key != "*":
        yield from find(data.get(key), rest, (*at, key))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            if key in ("*", index):
                yield from find(value, rest, (*at, index))


def entries(data: Any, *pattern: str | int) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    """Mappings among all that ``find`` finds."""
    return ((path, value) for path, value in find(data, pattern) if isinstance(value, dict))


def codes(data: Any) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    """Entries of ``blackbox``, whether it is one or a list."""
    yield from entries(data, "blackbox")
    yield from entries(data, "blackbox", "*")


def get(data: Any, *path: str | int) -> Any:
    """The value at a path, or None when there is none."""
    return next((value for _, value in find(data, path)), None)


def matches(path: KeyPath, pattern: KeyPath) -> bool:
    """Whether a path fits a pattern of ``find``."""
    return len(path) == len(pattern) and all(p == q or (q == "*" and isinstance(p, int))
                                             for p, q in zip(path, pattern))


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_per_step(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def is_vectors(value: Any) -> bool:
    return is_per_step(value) and all(isinstance(row, list) and all(map(is_number, row))
                                      for row in value)


def rows_of(value: Any) -> list[list[Any]]:
    """The vectors of a raw value, one or one per load step; none where it has another shape, which
    is complained of elsewhere.
    """
    rows = value if is_per_step(value) else [value]
    return rows if all(isinstance(row, list) and len(row) == 3 for row in rows) else []


def free_at_times(path: KeyPath, rows: list[list[Any]]) -> Iterator[Problem]:
    """Components that are null at some load steps and not at others."""
    for name, values in zip("xyz", zip(*rows)):
        if None in values and any(x is not None for x in values):
            yield Problem(path, f"component {name} free at some steps only",
                          "free at all load steps or at none",
                          "give a number, or null, at every step")


def law_of(entry: Any) -> Any:
    """The class of the law that a raw entry of ``interfaces`` names; of none, or of an unknown one,
    the default.
    """
    name = entry.get("law") if isinstance(entry, dict) else None
    return LAWS[name if isinstance(name, str) and name in LAWS else DEFAULT_LAW]


def follows(data: Any) -> bool:
    """Whether sides of some interface are paired anew as they slide."""
    return any(entry.get("pairing") == "follow" for _, entry in entries(data, "interfaces", "*"))


def all_perfect(data: Any) -> bool:
    """Whether all entries of ``interfaces`` are perfect."""
    return all(law_of(entry).perfect for _, entry in find(data, ("interfaces", "*")))


def called_twice(data: Any, where: KeyPath, what: str, default: str) -> Iterator[Problem]:
    """Entries of one name; without one, they have a default name with their number in it."""
    seen: dict[str, int] = {}
    for path, entry in entries(data, *where):
        name = entry.get("name") or default.format(path[-1] + 1)
        if name and isinstance(name, str) and seen.setdefault(name, path[-1]) != path[-1]:
            yield Problem((*path, "name"), f"a second {what} called '{name}'",
                          f"a name for each {what}", "give it another name")


def shown(value: Any) -> str:
    """Text of a value that does not depend on the order of keys nor on 1 against 1.0."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {shown(value[key])}" for key in sorted(value)) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(shown, value)) + "]"
    return f"{value:.12g}" if is_number(value) else str(value)


# ---- what is done to it before it is validated ---------------------------------------------------

# An override that picks one alternative removes the others, and what belongs to them alone.
# Two mesh sources stay an error: a mesh decides what all other entries mean.
ALTERNATIVES: list[tuple[KeyPath, list[set[str]]]] = [
    (("method", "tolerance"), [{"error"}, {"law"}, {"indicator"}]),
    (("subdomains",), [{"slices"}, {"grid"}, {"metis"}, {"groups", "split_above"}]),
    (("boundary", "*"), [{key} for key in ON_FACES]),
    (("boundary", "*", "on"), [{"plane", "at"}, {"box"}]),
]
SHIPPED = "gmsh:"  # models that come with gmsh; the scene knows where they are


def parse(text: str, parse_value: Callable[[str], Any]) -> tuple[KeyPath, Any]:
    """``"materials.0.young=1"`` → ``(("materials", 0, "young"), 1)``; raises InputError without a
    ``=``, or with an empty key.
    """
    keys, equals, value = text.partition("=")
    parts = [key.strip() for key in keys.split(".")]
    if not equals or not all(parts):
        raise wrong((), text, "key=value, such as method.max_iterations=100",
                    "write the key, =, and the value")
    return tuple(int(key) if key.isdigit() else key for key in parts), parse_value(value)


def places(data: Any, path: KeyPath, at: KeyPath = ()) -> list[KeyPath]:
    """The paths that a path means: a ``*`` in it stands for every entry of the list there. Raises
    InputError where there is no list.

    >>> places({"bolts": [{}, {}]}, ("bolts", "*", "force"))
    [('bolts', 0, 'force'), ('bolts', 1, 'force')]
    """
    if "*" not in path:
        return [at + path]
    here = path.index("*")
    there = get(data, *path[:here])
    if not isinstance(there, list) or not there:
        raise wrong((*at, *path[:here + 1]),
                    f"'*' for {dotted((*at, *path[:here]))}, which has no entries",
                    "a list with entries",
                    "name the key itself; new entries belong in the file")
    return [place for index, entry in enumerate(there)
            for place in places(entry, path[here + 1:], (*at, *path[:here], index))]


def apply(data: Any, path: KeyPath, value: Any, at: KeyPath = ()) -> Any:
    """The data with the value at a path replaced or added; mappings on the way are created. Raises
    InputError for an index outside a
    list, or a name where a list is."""
    if not path:
        return value
    key, here = path[0], (*at, path[0])
    if isinstance(data, list):
        if not isinstance(key, int) or key >= len(data):
            raise wrong(here, f"'{key}' in a list of {len(data)} entries",
                        f"an index from 0 to {len(data) - 1}",
                        "take an existing entry; new ones belong in the file")
        return [apply(entry, path[1:], value, here) if index == key else entry
                for index, entry in enumerate(data)]
    key = str(key)
    kept = data if isinstance(data, dict) else {}
    for pattern, known in ALTERNATIVES:
        if matches(at,
                   pattern) and (chosen := next((names for names in known if key in names), None)):
            removed = set().union(*known) - chosen
            kept = {name: entry for name, entry in kept.items() if name not in removed}
    return {**kept, key: apply(kept.get(key), path[1:], value, here)}


def with_files(data: Any, folder: Path) -> tuple[Any, list[Problem]]:
    """The data with files looked up beside the YAML file first, then in the current folder;
    problems of those not there.
    """
    problems: list[Problem] = []

    def found(name: Any, path: KeyPath) -> Any:
        """A file's path, or a list of such; what is no name is left as it is."""
        if isinstance(name, list):
            return [found(one, (*path, i)) for i, one in enumerate(name)]
        if not isinstance(name,
                          str) or not name or path[-2:] == ("mesh",
                                                            "step") and name.startswith(SHIPPED):
            return name
        known = [os.path.normpath(folder / name), os.path.normpath(name)]
        several = path[-2:] == ("mesh", "file")
        there = next((file for file in known if os.path.isfile(file) or several
                      and any(map(os.path.isfile, glob(file)))), None)
        if there is None:
            problems.append(Problem(path, f"no file {' nor '.join(dict.fromkeys(known))}",
                                    "an existing file",
                                    "paths are relative to the YAML file's folder"))
        return there or name

    places = [*((*mesh, key) for mesh in (("mesh",), ("parts", "*", "mesh"))
                for key in ("file", "step")),
              *(("parts", "*", kind, key) for kind, part in KINDS.items() for key in part.files),
              *(("loads", "*", name, key) for name, kind in IN_VOLUMES.items()
                for key in kind.files)]
    for path, name in [one for pattern in places for one in find(data, pattern)]:
        data = apply(data, path, found(name, path))
    entry = get(data, "blackbox")
    if entry is not None:  # a code knows which of its keys name files
        own = [settings_class(e).beside(e, folder) if isinstance(e, dict) else e
               for e in (entry if isinstance(entry, list) else [entry])]
        data = {**data, "blackbox": own if isinstance(entry, list) else own[0]}
    return data, problems

