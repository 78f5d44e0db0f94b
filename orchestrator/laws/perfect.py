"""No jump, d = 0, so f̂ = F (paper, eq. 7): perfect. Or one that is imposed, d = d₀, so f̂ = F −
keq d₀: a bolt is tightened by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from orchestrator.config.base import one_or_per_step, Vector
from orchestrator.config.boundary import Entry
from orchestrator.laws.base import Law, Moves
from orchestrator.laws.points import Answer, BONDED, Points


class Perfect(Law):
    """Bonded: the undamaged body.

    d = 0
    """

    name = "perfect"
    Parameters = Entry
    moves, convex, given_jump = Moves.TOGETHER, True, np.zeros(3)

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂ = F."""
        count = F.shape[1]
        answer = Answer(F, np.full(count, BONDED))
        if derivative:
            answer.active, answer.derivative = np.arange(count), np.broadcast_to(
                np.eye(3)[:, :, None], (3, 3, count))
        return answer


Imposed = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")


class JumpEntry(Entry):
    """An imposed jump of displacement."""

    per_step: ClassVar[tuple[str, ...]] = ("jump",)

    jump: Imposed = Field(description=(
        "imposed jump from the first part to the second: three numbers, as [0, 0, 0.01], or a "
        "list of such, one per load step"))

    @property
    def scaled(self) -> tuple[str, ...]:
        return ("jump",)

    def at_steps(self, factors: Sequence[float]) -> list[Entry]:
        if isinstance(self.jump[0], list):
            return [self.model_copy(update={"jump": jump}) for jump in self.jump]
        return super().at_steps(factors)

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        if raw.get("between") == "auto":
            yield ("between", "auto beside law: jump",
                   "the names of two parts: the jump leads from the first to the second",
                   "name them")


@dataclass(frozen=True, eq=False)
class Jump(Law):
    """Imposed jump of displacement.

    d = given

    given_jump : (3,) from side 1 to side 2
    """

    given_jump: np.ndarray

    name = "jump"
    Parameters = JumpEntry
    moves, convex = Moves.GIVEN, True

    @classmethod
    def of(cls, entry: JumpEntry, count: int, direction: float,
           distance: np.ndarray | None = None) -> Jump:
        return cls(direction * np.asarray(entry.jump, float))

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        return {"jump": np.repeat(self.given_jump[:, None], len(chosen), axis=1)}

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂ = F − keq d₀: bonded, as seen from the jump."""
        return Perfect.force(points, F - points.stiffness(points["jump"]), previous, derivative)
