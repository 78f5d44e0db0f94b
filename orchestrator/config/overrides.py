"""``--set a.b.c=value``: changes to the raw data before it is validated."""

from __future__ import annotations

from typing import Any

from orchestrator.config.rules.combinations import ONE_OF
from orchestrator.config.paths import matches
from orchestrator.errors import KeyPath, Problem

# An override that picks one alternative removes the others, and what belongs to them alone.
# Two mesh sources stay an error: a mesh decides what all other entries mean.
ALTERNATIVES: list[tuple[KeyPath, list[set[str]]]] = [
    (("method", "tolerance"), [{key} for key in ONE_OF["method", "tolerance"]]),
    (("subdomains",), [{"slices"}, {"grid"}, {"metis"}, {"groups", "split_above"}]),
    (("boundary", "*"), [{key} for key in ONE_OF["boundary", "*"]]),
    (("boundary", "*", "on"), [{"plane", "at"}, {"box"}]),
]


class BadOverride(Exception):
    """An override that cannot be applied; ``problem`` says why."""

    def __init__(self, path: KeyPath, found: str, expected: str, cure: str):
        self.problem = Problem(path, found, expected, cure)
        super().__init__(found)


def parse(text: str, parse_value: Any) -> tuple[KeyPath, Any]:
    """``"materials.0.young=1"`` → ``(("materials", 0, "young"), 1)``.

    Raises
    ------
    BadOverride : no ``=``, or an empty key
    """
    keys, equals, value = text.partition("=")
    parts = [key.strip() for key in keys.split(".")]
    if not equals or not all(parts):
        raise BadOverride((), text, "key=value, such as method.max_iterations=100", "write the key, =, and the value")
    return tuple(int(key) if key.isdigit() else key for key in parts), parse_value(value)


def apply(data: Any, path: KeyPath, value: Any) -> Any:
    """The data with the value at a path replaced or added; mappings on the way are created.

    Raises
    ------
    BadOverride : an index outside a list, or a name where a list is
    """
    return _set(data, path, value, ())


def _set(data: Any, path: KeyPath, value: Any, at: KeyPath) -> Any:
    if not path:
        return value
    key, here = path[0], (*at, path[0])
    if isinstance(data, list):
        if not isinstance(key, int) or key >= len(data):
            raise BadOverride(here, f"'{key}' in a list of {len(data)} entries", f"an index from 0 to {len(data) - 1}",
                              "take an existing entry; new ones belong in the file")
        return [_set(entry, path[1:], value, here) if index == key else entry for index, entry in enumerate(data)]
    key = str(key)
    kept = data if isinstance(data, dict) else {}
    for pattern, alternatives in ALTERNATIVES:
        if matches(at, pattern) and (chosen := next((names for names in alternatives if key in names), None)):
            removed = set().union(*alternatives) - chosen
            kept = {name: entry for name, entry in kept.items() if name not in removed}
    return {**kept, key: _set(kept.get(key), path[1:], value, here)}
