"""What rules look at: the shape of raw values, and how they are written in messages."""

from __future__ import annotations

from typing import Any

from orchestrator.errors import KeyPath
from orchestrator.registry import DEFAULT_LAW, LAWS


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
