"""Anderson's acceleration of the nonlinear fixed point s = F(s), all load steps as one vector.

Type II with a window of m differences around the latest evaluation: the combination of least
residual r = F(s) − s, in the norm of (k⁺)⁻¹, then a step along its residual,

    s ← s + β r − Σ γ_i (Δs_i + β Δr_i),     γ = argmin ‖r − Σ γ_i Δr_i‖

The window is dropped when the residual has grown far beyond the best one: the statuses that it
speaks of are gone.

Differences are kept in double precision: single moves a state by 6e-8 of its last changes, and a
body that stabilisation alone holds by that over ε. Ten grains at 1e-10 then stagnate at 6e-10.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.acceleration import Acceleration
from orchestrator.method.acceleration.residual_minimisation import ResidualMinimisation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

REGULARISATION = 1e-10
FORGET = 2.0  # times the best residual
# Where matter is nonlinear, residuals of good steps rise and fall by up to three times: a window
# dropped at twice the best is
# dropped at every other step (54 iterations in place of 20). From 5 to 100 it makes no difference.
FORGET_FLOWING = 10.0
MEMORY, RELAXATION = 30, 0.8  # of auto


class Anderson(Acceleration):
    """Acceleration for laws with history.

    weight : (D,) float, squared weights of the norm
    memory : differences kept
    relaxation : β, the step along the residual
    team : the ranks that share the state
    forget : times the best residual, above which the window is dropped
    """

    title = "Anderson's acceleration, type II"

    def __init__(self, weight: np.ndarray, memory: int, relaxation: float, team: Team = ALONE,
                 forget: float = FORGET):
        self.root, self.memory, self.relaxation, self.team, self.forget = np.sqrt(
            weight), memory, relaxation, team, forget
        self.count, self.smallest = 0, np.inf
        # Δr_i·Δr_j, and Δr_i·r of the latest r
        self.gram, self.right = np.zeros((memory, memory)), np.zeros(memory)
        # (m, T D) Δs + β Δr, and root Δr; the oldest is overwritten
        self.changes = self.differences = np.empty((0, 0))
        self.latest: tuple[np.ndarray, np.ndarray] | None = None  # s and r

    @classmethod
    def suiting(cls, all_perfect: bool) -> type[Acceleration]:
        """The variant for affine maps, which minimises the residual."""
        return ResidualMinimisation if all_perfect else cls

    @classmethod
    def of(cls, d: Decomposition, method) -> Anderson:
        """``relaxation: auto`` is 0.8."""
        return cls(1 / d.stage.direction.diagonal,
                   MEMORY if method.memory == "auto" else method.memory,
                   RELAXATION if method.relaxation == "auto" else method.relaxation, d.space.team,
                   FORGET if d.nonlinear is None else FORGET_FLOWING)

    @property
    def kept(self) -> int:
        """Differences in the window."""
        return min(self.count, self.memory)

    @property
    def depth(self) -> int:
        return 1 + self.kept

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation; among ranks one message."""
        s, residual = evaluated.s, image - evaluated.s
        weighted = self.root * residual
        square, products = np.vdot(weighted, weighted), np.zeros((2, 0))
        if self.latest is not None:
            products = self._remember(s, residual, weighted.ravel())
        square, products = self.team.sum(square, products)
        if self.latest is not None:
            place = (self.count - 1) % self.memory
            self.gram[place, : self.kept] = self.gram[: self.kept, place] = products[0]
            self.right[: self.kept] = products[1]
        size = float(np.sqrt(square))
        if size > self.forget * self.smallest:
            self.count, self.smallest = 0, size
        self.smallest = min(self.smallest, size)
        self.latest = s, residual
        return residual

    def _remember(self, s: np.ndarray, residual: np.ndarray, weighted: np.ndarray) -> np.ndarray:
        """Keep the latest differences; (2, n) this rank's products of Δr, and of r, with all."""
        if self.differences.shape[1] != s.size:
            # the system gives memory to what is written
            self.changes, self.differences = np.empty((2, self.memory, s.size))
        place, (s_before, r_before) = self.count % self.memory, self.latest
        self.count += 1
        change, difference = (x[place].reshape(s.shape) for x in (self.changes, self.differences))
        np.subtract(residual, r_before, out=difference)
        np.subtract(s, s_before, out=change)
        change += self.relaxation * difference
        difference *= self.root
        kept = self.differences[: self.kept]
        return np.stack([kept @ kept[place], kept @ weighted])

    def next(self) -> np.ndarray:
        s, residual = self.latest
        state, n = s + self.relaxation * residual, self.kept
        size = np.sqrt(np.diag(self.gram)[:n])
        size[size == 0] = 1.0
        scaled = self.gram[:n, :n] / np.outer(size, size) + REGULARISATION * np.eye(n)
        gamma = np.linalg.solve(scaled, self.right[:n] / size) / size
        state -= (gamma @ self.changes[:n]).reshape(s.shape) if n else 0.0
        return state
