"""Imposed jump: d = d₀, so f̂ = F − keq d₀. A bolt is tightened by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Vector
from orchestrator.config.entry import Entry
from orchestrator.laws.base import Law
from orchestrator.laws.perfect import Perfect
from orchestrator.laws.points import Answer, Points


class Parameters(Entry):
    """An imposed jump of displacement."""

    jump: Vector = Field(description="imposed jump from the first part to the second: three numbers, as [0, 0, 0.01]")

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        if raw.get("between") == "auto":
            yield ("between", "auto beside law: jump", "the names of two parts: the jump leads from the first to the second",
                   "name them")


@dataclass(frozen=True, eq=False)
class Jump(Law):
    """Imposed jump of displacement.

    Parameters
    ----------
    jump : (3,) from side 1 to side 2
    """

    jump: np.ndarray

    name = "jump"
    Parameters = Parameters
    formula, meaning = "d = given", "imposed jump of displacement"
    as_one, joins, has_history = True, True, False

    @property
    def homogeneous(self) -> bool:
        return not self.jump.any()

    @property
    def imposed(self) -> float:
        return float(np.linalg.norm(self.jump))

    @classmethod
    def of(cls, entry: Parameters, count: int, direction: float, distance: np.ndarray | None = None) -> Jump:
        return cls(direction * np.asarray(entry.jump, dtype=float))

    def parameters(self, chosen: np.ndarray, length: np.ndarray, area: np.ndarray) -> dict[str, np.ndarray]:
        return {"jump": np.repeat(self.jump[:, None], len(chosen), axis=1)}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
        """f̂ = F − keq d₀: bonded, as seen from the jump."""
        return Perfect.force(points, F - points.stiffness(points["jump"]), previous, derivative)
