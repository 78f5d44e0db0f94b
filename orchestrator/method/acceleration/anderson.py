"""Anderson's acceleration of the nonlinear fixed point s = F(s), all load steps as one vector.

Type II with a window of m differences around the latest evaluation: the combination of least
residual, in the norm of (k⁺)⁻¹, then a step along its residual. The memory is dropped when the
residual has grown far beyond the best one: the statuses that it speaks of are gone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.acceleration.base import Acceleration, squared_weights
from orchestrator.method.acceleration.history import History, weighted_residual
from orchestrator.method.acceleration.residual_minimisation import ResidualMinimisation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import Memory
from orchestrator.parallel.team import ALONE, Team

REGULARISATION = 1e-10
FORGET = 2.0  # times the best residual
# Where matter is nonlinear, residuals of good steps rise and fall by up to three times: a memory dropped at twice the best is
# dropped at every other step (54 iterations in place of 20). From 5 to 100 it makes no difference.
FORGET_FLOWING = 10.0
MEMORY, RELAXATION = 30, 0.8  # of auto


class Anderson(Acceleration):
    """Acceleration for laws with history.

    Parameters
    ----------
    weight : (D,) float, squared weights of the norm
    memory : differences kept
    relaxation : β, the step along the residual
    team : the ranks that share the state
    forget : times the best residual, above which the memory is dropped
    """

    title = "Anderson's acceleration, type II"

    def __init__(self, weight: np.ndarray, memory: int, relaxation: float, team: Team = ALONE,
                 forget: float = FORGET):
        self.root, self.team = np.sqrt(weight), team
        self.history = History(memory, self.root, float(relaxation))
        self.gram, self.right = np.zeros((0, 0)), np.zeros(0)  # products of all differences of r, and with the latest r
        self.s = self.r = None
        self.smallest, self.forget = np.inf, forget

    @classmethod
    def suiting(cls, all_perfect: bool) -> type[Acceleration]:
        """As the base class says: of affine maps, the residual is minimised."""
        return ResidualMinimisation if all_perfect else cls

    @classmethod
    def of(cls, d: Decomposition, method) -> Anderson:
        """As the base class says; ``relaxation: auto`` is 0.8."""
        return cls(squared_weights(d), MEMORY if method.memory == "auto" else method.memory,
                   RELAXATION if method.relaxation == "auto" else method.relaxation, d.space.team,
                   FORGET if d.nonlinear is None else FORGET_FLOWING)

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation."""
        s = evaluated.s
        residual, r, square = weighted_residual(s, image, self.root)
        size = self._remember(s, r, square)
        if size > self.forget * self.smallest:
            self.history.clear()
            self.gram, self.right = np.zeros((0, 0)), np.zeros(0)
            self.smallest = size
        self.smallest = min(self.smallest, size)
        self.s, self.r, self.image = s, r, image
        return residual

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, float], int]:
        """The last evaluation, and how many before it are remembered as differences."""
        return ({"trace/s": self.s, "trace/image": self.image}, {"smallest": self.smallest, "differences": len(self.history)},
                1 + len(self.history))

    def recall(self, memories: Sequence[Memory]) -> None:
        """Form the differences of the last evaluations again."""
        latest = memories[-1].notes["acceleration"]
        for memory in memories[-1 - latest["differences"]:]:
            s, self.image = memory.arrays["trace/s"], memory.arrays["trace/image"]
            r = weighted_residual(s, self.image, self.root)[1]
            if self.s is not None:
                self._remember(s, r)
            self.s, self.r = s, r
        self.smallest = latest["smallest"]

    def _remember(self, s: np.ndarray, r: np.ndarray, square: float = 0.0) -> float:
        """Take in what this evaluation has changed, if there has been one before it; ‖r‖, from this rank's part of its square.

        All travel in one message: what is to be forgotten at once has been formed in vain, and that is rare.
        """
        if self.s is None:
            return float(np.sqrt(self.team.sum(square)[0]))
        if len(self.history) == self.history.memory:
            self.gram = self.gram[1:, 1:]
        square, (row, self.right) = self.team.sum(square, self.history.add(s, r, self.s, self.r))
        grown = np.empty((len(row), len(row)))
        grown[:-1, :-1] = self.gram
        grown[-1], grown[:, -1] = row, row
        self.gram = grown
        return float(np.sqrt(square))

    def next(self) -> np.ndarray:
        """State to evaluate next."""
        size = np.sqrt(np.diag(self.gram))
        size[size == 0] = 1.0
        scaled = self.gram / np.outer(size, size)
        scaled[np.diag_indices_from(scaled)] += REGULARISATION
        return self.history.next(self.s, self.r, np.linalg.solve(scaled, self.right / size) / size)
