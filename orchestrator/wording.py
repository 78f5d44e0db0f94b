"""Turns of phrase that messages of several rooms share."""

from __future__ import annotations

from collections.abc import Sequence

SHOWN = 4  # names in a sentence


def some(names: Sequence[str], shown: int = SHOWN) -> str:
    """The first of many names, and how many more there are."""
    return ", ".join(names[:shown]) + (f" and {len(names) - shown} more" if len(names) > shown else "")
