"""Accelerations of the fixed point s = F(s), a row (load step) at a time.

Every evaluation gives a residual r = F(s) − s. ``none`` relaxes, eq. 12. The others minimise the
residual over affine combinations of the evaluations so far. Written with orthonormal residual
differences this is the generalised conjugate residual method: with the whole history kept it is
GMRES for affine F, with the last m directions it is Anderson's acceleration of type II.

    Δs = s − s*,  Δr = r − r*        what the evaluation adds to the best combination (s*, r*)
    orthonormalise Δr against the kept directions, the same steps on Δs
    s* ← s* + Δs γ,  r* ← r* + Δr γ,  γ = −Δrᵀr*
    next evaluation at s* + β r*

References: Walker & Ni, SIAM J. Numer. Anal. 49 (2011); Eisenstat, Elman & Schultz, ibid. 20 (1983).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.interface.rows import dots
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

DEPENDENT = 1e-12  # a direction that loses this much in orthogonalisation is noise


class Relaxation:
    """Plain fixed point s ← s + α (F(s) − s), eq. 12.

    Parameters
    ----------
    relaxation : α in (0, 1]
    """

    title = "none: relaxation"

    def __init__(self, relaxation: float):
        self.relaxation = relaxation

    def take(self, evaluated: Admissible, image: np.ndarray) -> tuple[np.ndarray, Admissible]:
        """Take in an evaluation; the best known point is the evaluation itself."""
        self.s, self.residual = evaluated.s, image - evaluated.s
        return self.residual, evaluated

    def next(self) -> np.ndarray:
        """State to evaluate next."""
        return self.s + self.relaxation * self.residual


class ResidualMinimisation:
    """Anderson's acceleration or GMRES, by orthogonalised residual differences.

    Parameters
    ----------
    complete : (s, u, α) → admissible fields, as ``LinearStage.complete``
    weight : (D,) float, squared weights of the norm in which residuals are minimised
    memory : directions kept; None keeps all
    relaxation : β of the next evaluation
    team : the ranks that share the state
    """

    title = "residual minimisation (generalised conjugate residuals, equivalent to GMRES)"

    def __init__(self, complete: Callable[..., Admissible], weight: np.ndarray, memory: int | None, relaxation: float,
                 team: Team = ALONE):
        self.complete, self.root = complete, np.sqrt(weight)
        self.memory, self.relaxation, self.team = memory, relaxation, team
        self.directions: list[tuple[np.ndarray, list[np.ndarray]]] = []
        self.r: np.ndarray | None = None
        self.point: list[np.ndarray] = []

    def take(self, evaluated: Admissible, image: np.ndarray) -> tuple[np.ndarray, Admissible]:
        """Take in an evaluation; residual and fields at the combination of least residual.

        u and α are affine functions of s: they are combined like it.
        """
        r, point = self.root * (image - evaluated.s), [evaluated.s, evaluated.u, evaluated.alpha]
        if self.r is None:
            self.r, self.point, best = r, point, evaluated
        else:
            dr = r - self.r
            dp = [a - b for a, b in zip(point, self.point)]
            scale, size = self.r, dr.copy()
            for _ in range(2):  # twice is enough
                # all products at once: one message among the ranks
                coefficients = self.team.sum(*(dots(q, dr) for q, _ in self.directions))
                for (q, p), c in zip(self.directions, coefficients):
                    dr -= q * c[:, None]
                    for a, b in zip(dp, p):
                        a -= b * c[:, None]
            norm, size, scale, along = self.team.sum(dots(dr, dr), dots(size, size), dots(scale, scale),
                                                     dots(dr, self.r))
            norm, size = np.sqrt(norm), np.sqrt(size)
            good = (norm > DEPENDENT * size) & (scale > 0)
            inverse = np.where(good, 1 / np.where(good, norm, 1), 0.0)
            dr *= inverse[:, None]
            for a in dp:
                a *= inverse[:, None]
            self.directions.append((dr, dp))
            if self.memory is not None and len(self.directions) > self.memory:
                self.directions.pop(0)
            gamma = (-along * inverse)[:, None]
            self.r = self.r + dr * gamma
            self.point = [a + b * gamma for a, b in zip(self.point, dp)]
            best = self.complete(*self.point)
        return self.r / self.root, best

    def next(self) -> np.ndarray:
        """State to evaluate next."""
        return self.point[0] + self.relaxation * self.r / self.root
