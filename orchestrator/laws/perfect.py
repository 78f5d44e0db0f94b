"""Perfect interface: no jump, d = 0, so f̂ = F (paper, eq. 7)."""

from __future__ import annotations

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer, BONDED, Points


class Perfect(Law):
    """Bonded: the undamaged body."""

    name = "perfect"
    Parameters = Entry
    formula, meaning = "d = 0", "bonded"
    perfect = as_one = True
    joins, has_history = True, False
    convex = True

    @property
    def given_jump(self) -> np.ndarray:
        return np.zeros(3)

    @classmethod
    def of(cls, entry: Entry, count: int, direction: float, distance: np.ndarray | None = None) -> Perfect:
        return cls()

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
        """f̂ = F."""
        count = F.shape[1]
        answer = Answer(F, np.full(count, BONDED))
        if derivative:
            answer.active, answer.derivative = np.arange(count), np.broadcast_to(np.eye(3)[:, :, None], (3, 3, count))
        return answer
