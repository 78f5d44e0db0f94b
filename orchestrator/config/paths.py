"""Looking things up in the raw data of a YAML file, whatever shape it has, and how values are written in messages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from orchestrator.errors import KeyPath
from orchestrator.registry import DEFAULT_LAW, LAWS


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
    elif pattern[0] == "*":
        for index, value in enumerate(data if isinstance(data, list) else []):
            yield from find(value, pattern[1:], (*at, index))
    elif isinstance(pattern[0], int):
        if isinstance(data, list) and pattern[0] < len(data):
            yield from find(data[pattern[0]], pattern[1:], (*at, pattern[0]))
    elif isinstance(data, dict):
        yield from find(data.get(pattern[0]), pattern[1:], (*at, pattern[0]))


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
    return is_per_step(value) and all(isinstance(row, list) and all(map(is_number, row)) for row in value)


def law_of(entry: Any) -> Any:
    """The class of the law that a raw entry of ``interfaces`` names; of none, or of an unknown one, the default."""
    name = entry.get("law") if isinstance(entry, dict) else None
    return LAWS[name if isinstance(name, str) and name in LAWS else DEFAULT_LAW]


def dotted(path: KeyPath) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")


def shown(value: Any) -> str:
    """Text of a value that does not depend on the order of keys nor on 1 against 1.0."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {shown(value[key])}" for key in sorted(value)) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(shown, value)) + "]"
    return f"{value:.12g}" if is_number(value) else str(value)
