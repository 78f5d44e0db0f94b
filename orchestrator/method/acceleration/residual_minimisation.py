"""Residual minimisation of the fixed point s = F(s), a row (load step) at a time.

Every evaluation gives a residual r = F(s) − s, which is minimised over affine combinations of the
evaluations so far. Written with orthonormal residual differences this is the generalised conjugate
residual method: with the whole history kept it is GMRES for affine F, with the last m directions it
is Anderson's acceleration of type II.

    Δs = s − s*,  Δr = r − r*        what the evaluation adds to the best combination (s*, r*)
    orthonormalise Δr against the kept directions, the same steps on Δs
    s* ← s* + Δs γ,  r* ← r* + Δr γ,  γ = −Δrᵀr*
    next evaluation at s* + β r*

Orthogonalised twice, all at once each time: that leaves what rounding leaves (Giraud, Langou,
Rozložník & van den Eshof, Numer. Math. 101, 2005), and takes three messages among ranks whatever
the number of directions.

References: Walker & Ni, SIAM J. Numer. Anal. 49 (2011); Eisenstat, Elman & Schultz, ibid. 20
(1983).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.method.acceleration import Acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import add, dots, ratio
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

DEPENDENT = 1e-12  # a direction that loses this much in orthogonalisation is noise


class ResidualMinimisation(Acceleration):
    """Anderson's acceleration or GMRES, by orthogonalised residual differences.

    complete : (s, u, α) → admissible fields, as ``LinearStage.complete``
    weight : (D,) float, squared weights of the norm in which residuals are minimised
    memory : directions kept; None keeps all
    relaxation : β of the next evaluation
    team : the ranks that share the state
    """

    title = "residual minimisation (generalised conjugate residuals, equivalent to GMRES)"

    def __init__(self, complete: Callable[..., Admissible], weight: np.ndarray, memory: int | None,
                 relaxation: float, team: Team = ALONE):
        self.complete, self.root, self.relaxation, self.team = complete, np.sqrt(
            weight), relaxation, team
        self.depth = None if memory is None else memory + 1
        self.directions: list[tuple[np.ndarray, list[np.ndarray]]] = []
        self.r: np.ndarray | None = None
        self.point: list[np.ndarray] = []

    @classmethod
    def of(cls, d: Decomposition, method) -> ResidualMinimisation:
        """``relaxation: auto`` is 1."""
        memory = (
            None if method.acceleration == "gmres" or method.memory == "auto" else method.memory)
        relaxation = 1.0 if method.relaxation == "auto" else method.relaxation
        return cls(d.stage.complete, 1 / d.stage.direction.diagonal, memory, relaxation,
                   d.space.team)

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation; residual at the combination of least residual. u and α are affine
        in s: combined like it.
        """
        r, point = self.root * (image - evaluated.s), [evaluated.s, evaluated.u, evaluated.alpha]
        if self.r is None:
            self.r, self.point = r, point
        else:
            dr, dp = r - self.r, [a - b for a, b in zip(point, self.point)]
            size, scale, *steps = self.team.sum(
                dots(dr, dr), dots(self.r, self.r), *self._along(dr))
            self._without(dr, steps)
            if steps:
                more = self.team.sum(*self._along(dr))  # what rounding has left
                self._without(dr, more)
                steps = np.add(steps, more)
            for (_, p), c in zip(self.directions, steps):
                for a, b in zip(dp, p):
                    add(a, -c, b)
            norm, along = self.team.sum(dots(dr, dr), dots(dr, self.r))
            norm = np.sqrt(norm)
            inverse = ratio(1.0, norm, (norm > DEPENDENT * np.sqrt(size)) & (scale > 0))
            for a in (dr, *dp):
                a *= inverse[:, None]
            self.directions.append((dr, dp))
            if self.depth is not None and len(self.directions) >= self.depth:
                self.directions.pop(0)
            gamma = (-along * inverse)[:, None]
            self.r = self.r + dr * gamma
            self.point = [a + b * gamma for a, b in zip(self.point, dp)]
        return self.r / self.root

    def best(self, evaluated: Admissible) -> Admissible:
        """The fields at the combination of least residual."""
        return self.complete(*self.point) if self.directions else evaluated

    def _along(self, dr: np.ndarray) -> list[np.ndarray]:
        """This rank's part of the products (T,) of dr with the directions kept."""
        return [dots(q, dr) for q, _ in self.directions]

    def _without(self, dr: np.ndarray, steps: Sequence[np.ndarray]) -> None:
        """Take the directions kept, times steps (T,) each, out of dr."""
        for (q, _), own in zip(self.directions, steps):
            add(dr, -own, q)

    def next(self) -> np.ndarray:
        return self.point[0] + self.relaxation * self.r / self.root
