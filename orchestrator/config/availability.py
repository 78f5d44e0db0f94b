"""What the grammar knows and this version cannot do yet. Delivering a feature deletes its row."""

from __future__ import annotations

from typing import Any

from ..errors import KeyPath, Problem
from .paths import find

ANY = object()

# where, the value concerned, what it is called, what to do meanwhile
NOT_YET: list[tuple[KeyPath, Any, str, str]] = [
    (("subdomains", "split_above"), ANY, "splitting large groups", "remove split_above, or use metis"),
]


def not_available(data: Any) -> list[Problem]:
    """Problems for everything in the raw data that this version cannot do yet."""
    return [Problem(path, f"{what}: not yet available in this version", "a feature of this version", cure)
            for pattern, wanted, what, cure in NOT_YET
            for path, value in find(data, pattern)
            if wanted is ANY or value == wanted]
