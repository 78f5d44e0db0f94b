"""Looking things up in the raw data of a YAML file, whatever shape it has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from orchestrator.errors import KeyPath


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
