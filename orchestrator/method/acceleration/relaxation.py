"""Relaxation of the fixed point: a constant α, eq. 12, or Aitken's, which follows from the last two
residuals.

    s ← s + α r,   r = F(s) − s          Aitken: α = −(s − s₀)·(r − r₀) / ‖r − r₀‖²

(Irons & Tuck, Int. J. Numer. Meth. Engng 1, 1969; Küttler & Wall, Comput. Mech. 43, 2008). All load
steps share one α.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.acceleration import Acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

USUAL = 0.8  # the paper's α
SAFE = 0.9  # α over the limit of convergence, where that is less


class Relaxation(Acceleration):
    """s ← s + α (F(s) − s), α in (0, 1]."""

    title = "none: relaxation"

    def __init__(self, relaxation: float):
        self.relaxation = relaxation

    @classmethod
    def of(cls, d: Decomposition, method) -> Relaxation:
        """``relaxation: auto`` is 0.8, or less if the two search directions differ much."""
        return cls(usual_relaxation(d, method))

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        self.s, self.residual = evaluated.s, image - evaluated.s
        return self.residual

    def next(self) -> np.ndarray:
        return self.s + self.relaxation * self.residual


class Aitken(Relaxation):
    """Relaxation by the last two residuals.

    relaxation : α of the first step
    weight : (D,) squared weights of the norm
    team : the ranks that share the state
    """

    title, depth = "Aitken's relaxation", 2

    def __init__(self, relaxation: float, weight: np.ndarray, team: Team = ALONE):
        super().__init__(relaxation)
        self.weight, self.team, self.s = weight, team, None

    @classmethod
    def of(cls, d: Decomposition, method) -> Aitken:
        """``relaxation: auto`` as in the base class."""
        return cls(usual_relaxation(d, method), 1 / d.stage.direction.diagonal, d.space.team)

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        before = None if self.s is None else (self.s, self.residual)
        super().take(evaluated, image)
        if before is not None:
            change = self.residual - before[1]
            along, square = self.team.sum(np.vdot(self.weight * change, self.s - before[0]),
                                          np.vdot(self.weight * change, change))
            if square > 0:
                self.relaxation = float(-along / square)
        return self.residual


def usual_relaxation(d: Decomposition, method) -> float:
    """α of ``method``; auto: what converges for the worst eigenvalues of all ranks, as k⁻ and k⁺ do
    not couple interfaces.
    """
    if method.relaxation != "auto":
        return method.relaxation
    low, high = d.local.conditioning()
    high, low = d.space.team.max(high, -low)
    return stable_relaxation(-low, high)


def stable_relaxation(low: float, high: float) -> float:
    """0.8, or 0.9 of the limit 2/(1 + max(λ, 1/λ)) where that is less; λ the eigenvalues of (k⁻,
    k⁺).
    """
    worst = max(high, 1 / low if low > 0 else np.inf)
    return max(min(USUAL, SAFE * 2 / (1 + worst)), 0.01)
