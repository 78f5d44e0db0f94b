"""Plain relaxation of the fixed point, eq. 12: s ← s + α (F(s) − s)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.acceleration.base import Acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import Memory

USUAL = 0.8  # the paper's α
SAFE = 0.9  # α over the limit of convergence, where that is less


class Relaxation(Acceleration):
    """s ← s + α (F(s) − s).

    Parameters
    ----------
    relaxation : α in (0, 1]
    """

    title = "none: relaxation"

    def __init__(self, relaxation: float):
        self.relaxation = relaxation

    @classmethod
    def of(cls, d: Decomposition, method) -> Relaxation:
        """As the base class says; ``relaxation: auto`` is 0.8, or less if the two search directions differ much."""
        return cls(usual_relaxation(d, method))

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """As the base class says."""
        self.s, self.residual = evaluated.s, image - evaluated.s
        return self.residual

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, float], int]:
        """The last evaluation."""
        return {"trace/s": self.s, "trace/residual": self.residual}, {"relaxation": self.relaxation}, 1

    def recall(self, memories: Sequence[Memory]) -> None:
        """Take the last evaluation back."""
        arrays, notes = memories[-1].arrays, memories[-1].notes["acceleration"]
        self.s, self.residual, self.relaxation = arrays["trace/s"], arrays["trace/residual"], notes["relaxation"]

    def next(self) -> np.ndarray:
        """As the base class says."""
        return self.s + self.relaxation * self.residual


def usual_relaxation(d: Decomposition, method) -> float:
    """α of ``method``; auto: what converges for the worst eigenvalues of all ranks, as k⁻ and k⁺ do not couple interfaces."""
    if method.relaxation != "auto":
        return method.relaxation
    low, high = d.local.conditioning()
    high, low = d.space.team.max(high, -low)
    return stable_relaxation(-low, high)


def stable_relaxation(low: float, high: float) -> float:
    """0.8, or 0.9 of the limit 2/(1 + max(λ, 1/λ)) where that is less; λ the eigenvalues of (k⁻, k⁺)."""
    worst = max(high, 1 / low if low > 0 else np.inf)
    return max(min(USUAL, SAFE * 2 / (1 + worst)), 0.01)
