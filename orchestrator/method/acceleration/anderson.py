"""Anderson's acceleration of the nonlinear fixed point s = F(s), all load steps as one vector.

Type II with a window of m differences around the latest evaluation: the combination of least
residual, in the norm of (k⁺)⁻¹, then a step along its residual. The memory is dropped when the
residual has grown far beyond the best one: the statuses that it speaks of are gone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.blas import daxpy

from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import Memory
from orchestrator.parallel.team import ALONE, Team

REGULARISATION = 1e-10
FORGET = 2.0  # times the best residual


class Anderson:
    """Acceleration for laws with history.

    Parameters
    ----------
    weight : (D,) float, squared weights of the norm
    memory : differences kept
    relaxation : β, the step along the residual
    team : the ranks that share the state
    """

    title = "Anderson's acceleration, type II"

    def __init__(self, weight: np.ndarray, memory: int, relaxation: float, team: Team = ALONE):
        self.root = np.sqrt(weight)
        self.memory, self.relaxation, self.team = memory, relaxation, team
        self.change: list[np.ndarray] = []  # of s + β r, where the step starts
        self.dr: list[np.ndarray] = []
        self.gram, self.right = np.zeros((0, 0)), np.zeros(0)  # products of all dr, and with the latest r
        self.s = self.r = None
        self.smallest = np.inf

    def take(self, evaluated: Admissible, image: np.ndarray) -> tuple[np.ndarray, Admissible]:
        """Take in an evaluation; the best known point is the evaluation itself."""
        s, residual = evaluated.s, image - evaluated.s
        r = self.root * residual
        size = float(np.sqrt(self.team.sum(np.vdot(r, r))[0]))
        if size > FORGET * self.smallest:
            self.change, self.dr, self.gram, self.right = [], [], np.zeros((0, 0)), np.zeros(0)
            self.smallest = size
        elif self.s is not None:
            self._remember(s, r)
        self.smallest = min(self.smallest, size)
        self.s, self.r, self.image = s, r, image
        return residual, evaluated

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, float], int]:
        """The last evaluation, and how many before it are remembered as differences."""
        return ({"trace/s": self.s, "trace/image": self.image}, {"smallest": self.smallest, "differences": len(self.dr)},
                1 + len(self.dr))

    def recall(self, memories: Sequence[Memory]) -> None:
        """Form the differences of the last evaluations again."""
        latest = memories[-1].notes["acceleration"]
        for memory in memories[-1 - latest["differences"]:]:
            s, self.image = memory.arrays["trace/s"], memory.arrays["trace/image"]
            r = self.root * (self.image - s)
            if self.s is not None:
                self._remember(s, r)
            self.s, self.r = s, r
        self.smallest = latest["smallest"]

    def _remember(self, s: np.ndarray, r: np.ndarray) -> None:
        if len(self.dr) == self.memory:
            self.change.pop(0)
            self.dr.pop(0)
            self.gram = self.gram[1:, 1:]
        dr = r - self.r
        self.change.append(s - self.s + self.relaxation * dr / self.root)
        self.dr.append(dr)
        row, self.right = self.team.sum(np.array([[np.vdot(dr, other), np.vdot(r, other)] for other in self.dr]).T)[0]
        grown = np.empty((len(row), len(row)))
        grown[:-1, :-1] = self.gram
        grown[-1], grown[:, -1] = row, row
        self.gram = grown

    def next(self) -> np.ndarray:
        """State to evaluate next."""
        state = np.ascontiguousarray(self.s + self.relaxation * self.r / self.root)
        if self.dr:
            size = np.sqrt(np.diag(self.gram))
            size[size == 0] = 1.0
            scaled = self.gram / np.outer(size, size)
            scaled[np.diag_indices_from(scaled)] += REGULARISATION
            flat = state.reshape(-1)
            for gamma, change in zip(np.linalg.solve(scaled, self.right / size) / size, self.change):
                daxpy(change.reshape(-1), flat, a=-gamma)  # in place
        return state
