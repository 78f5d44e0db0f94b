"""``on`` of the YAML in words."""

from __future__ import annotations

from collections.abc import Mapping


def place_text(on: str | Mapping[str, object]) -> str:
    """``on`` of the YAML in words: xmin, x = 0, box (0, 0, 0) … (1, 1, 1)."""
    if isinstance(on, str):
        return on
    if "plane" in on:
        return f"{on['plane']} = {on['at']:g}"
    return "box " + " … ".join("(" + ", ".join(f"{x:g}" for x in corner) + ")" for corner in on["box"])
