"""An entry of ``interfaces:`` in the YAML, as far as it is the same for all laws."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import Field

from orchestrator.config.base import Name, Part
from orchestrator.registry import DEFAULT_LAW


class Entry(Part):
    """The law between two parts; the last match wins. Each law derives its own, with its parameters."""

    between: Annotated[list[Name], Field(min_length=2, max_length=2)] = Field(
        ["*", "*"], description="names of the two parts, shell wildcards allowed, in either order")
    law: Name = Field(DEFAULT_LAW, description="perfect: bonded, the undamaged body")

    @property
    def apart(self) -> str:
        """The key that has the sides' distance read from the geometry; empty where they must touch."""
        return ""

    @property
    def reach(self) -> float | None:
        """How far apart sides are sought, a length; None: as the scene thinks fit."""
        return None

    @property
    def fit(self) -> float:
        """How deep the sides may be inside each other before loading, a length."""
        return 0.0

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        """Rules that concern several keys of the raw entry: key, what was found, what is expected, the cure."""
        return iter(())
