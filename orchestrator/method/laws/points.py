"""The node pairs a law works on, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

OPEN, STICK, SLIP, BONDED = 0, 1, 2, 3


@dataclass
class Points:
    """Node pairs that share a law; arrays of P rows. n points from side 1 to side 2.

    Parameters
    ----------
    normal : (P, 3) unit normals
    stiff_n, stiff_t : (P,) keq = k₁k₂/(k₁ + k₂) of the search direction, along n and across it
    gap : (P,) initial gap, negative for a press fit
    friction : (P,) Coulomb's coefficient
    jump : (P, 3) imposed jump
    """

    normal: np.ndarray
    stiff_n: np.ndarray
    stiff_t: np.ndarray
    gap: np.ndarray
    friction: np.ndarray
    jump: np.ndarray

    def along(self, x: np.ndarray) -> np.ndarray:
        """(P,) normal components of (P, 3)."""
        return np.einsum("pi,pi->p", x, self.normal)

    def across(self, x: np.ndarray) -> np.ndarray:
        """(P, 3) tangential parts of (P, 3)."""
        return x - self.along(x)[:, None] * self.normal

    def stiffness(self, x: np.ndarray) -> np.ndarray:
        """(P, 3) keq x."""
        return self.stiff_t[:, None] * x + ((self.stiff_n - self.stiff_t) * self.along(x))[:, None] * self.normal

    def compliance(self, x: np.ndarray) -> np.ndarray:
        """(P, 3) x / keq."""
        return x / self.stiff_t[:, None] + ((1 / self.stiff_n - 1 / self.stiff_t) * self.along(x))[:, None] * self.normal


@dataclass
class Answer:
    """What a law says.

    Parameters
    ----------
    force : (P, 3) f̂ on side 1
    status : (P,) OPEN, STICK, SLIP or BONDED
    active : (Q,) pairs whose force changes with F, only if the derivative is asked for
    derivative : (Q, 3, 3) ∂f̂/∂F at these
    """

    force: np.ndarray
    status: np.ndarray
    active: np.ndarray | None = None
    derivative: np.ndarray | None = None
