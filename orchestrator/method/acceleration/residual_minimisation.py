"""Residual minimisation of the fixed point s = F(s), a row (load step) at a time.

Every evaluation gives a residual r = F(s) − s, which is minimised over affine combinations of the evaluations so far.
Written with orthonormal residual differences this is the generalised conjugate residual method: with the whole history kept it
is GMRES for affine F, with the last m directions it is Anderson's acceleration of type II.

    Δs = s − s*,  Δr = r − r*        what the evaluation adds to the best combination (s*, r*)
    orthonormalise Δr against the kept directions, the same steps on Δs
    s* ← s* + Δs γ,  r* ← r* + Δr γ,  γ = −Δrᵀr*
    next evaluation at s* + β r*

Among ranks that takes one message. All products of Δr, of r* and of the direction before with the directions Q travel at
once: QᵀQ = I + E is measured, to rounding, before it is used, so that one pass

    Δr ← Δr − Q c,   c = (I − E) QᵀΔr,       ‖Δr − Q c‖² = ‖Δr‖² − 2 cᵀQᵀΔr + cᵀ(I + E) c

leaves of orthogonality what rounding of Δr leaves, and errors of earlier directions do not add up (the classical process
would lose it step by step). Where that difference cancels it is not believed, and a second pass follows, with a message.

References: Walker & Ni, SIAM J. Numer. Anal. 49 (2011); Eisenstat, Elman & Schultz, ibid. 20 (1983); on one reduction with
delayed corrections Świrydowicz, Langou, Ananthan, Yang & Thomas, Numer. Linear Algebra Appl. 28 (2021).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.method.acceleration import Acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import add, dots
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team

DEPENDENT = 1e-12  # a direction that loses this much in orthogonalisation is noise
# Of a square that is the difference of two, so much of these at least: twelve digits of it are right then. What a second pass
# would still find are angles of a hundred times rounding, which the next step measures.
AGAIN = 1e-4


class ResidualMinimisation(Acceleration):
    """Anderson's acceleration or GMRES, by orthogonalised residual differences.

    complete : (s, u, α) → admissible fields, as ``LinearStage.complete``
    weight : (D,) float, squared weights of the norm in which residuals are minimised
    memory : directions kept; None keeps all
    relaxation : β of the next evaluation
    team : the ranks that share the state
    """

    title = "residual minimisation (generalised conjugate residuals, equivalent to GMRES)"

    def __init__(self, complete: Callable[..., Admissible], weight: np.ndarray, memory: int | None, relaxation: float, team: Team = ALONE):
        self.complete, self.root, self.relaxation, self.team = complete, np.sqrt(weight), relaxation, team
        self.depth = None if memory is None else memory + 1
        self.directions: list[tuple[np.ndarray, list[np.ndarray]]] = []
        self.tilted: np.ndarray | None = None  # (T, n, n) E; of the last direction nothing is known yet
        self.r: np.ndarray | None = None
        self.point: list[np.ndarray] = []

    @classmethod
    def of(cls, d: Decomposition, method) -> ResidualMinimisation:
        """``relaxation: auto`` is 1."""
        memory = None if method.acceleration == "gmres" or method.memory == "auto" else method.memory
        relaxation = 1.0 if method.relaxation == "auto" else method.relaxation
        return cls(d.stage.complete, 1 / d.stage.direction.diagonal, memory, relaxation, d.space.team)

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """Take in an evaluation; residual at the combination of least residual. u and α are affine in s: combined like it."""
        r, point = self.root * (image - evaluated.s), [evaluated.s, evaluated.u, evaluated.alpha]
        if self.r is None:
            self.r, self.point = r, point
        else:
            dr = r - self.r
            before = [product for q, _ in self.directions for product in (dots(q, self.r), dots(q, self.directions[-1][0]))]
            size, scale, along, *products = self.team.sum(
                dots(dr, dr), dots(self.r, self.r), dots(dr, self.r), *before, *(dots(q, dr) for q, _ in self.directions))
            dp = [a - b for a, b in zip(point, self.point)]
            steps, norm, along = self._orthogonal(dr, size, scale, along, products)
            for (_, p), c in zip(self.directions, steps.T):
                for a, b in zip(dp, p):
                    add(a, -c, b)
            norm, size = np.sqrt(np.maximum(norm, 0.0)), np.sqrt(size)
            good = (norm > DEPENDENT * size) & (scale > 0)
            inverse = np.where(good, 1 / np.where(good, norm, 1), 0.0)
            dr *= inverse[:, None]
            for a in dp:
                a *= inverse[:, None]
            self.directions.append((dr, dp))
            self.tilted = np.pad(self.tilted, ((0, 0), (0, 1), (0, 1)))
            if self.depth is not None and len(self.directions) >= self.depth:
                self.directions.pop(0)
                self.tilted = self.tilted[:, 1:, 1:]
            gamma = (-along * inverse)[:, None]
            self.r = self.r + dr * gamma
            self.point = [a + b * gamma for a, b in zip(self.point, dp)]
        return self.r / self.root

    def best(self, evaluated: Admissible) -> Admissible:
        """The fields at the combination of least residual."""
        return self.complete(*self.point) if self.directions else evaluated

    def _orthogonal(self, dr: np.ndarray, size: np.ndarray, scale: np.ndarray, along: np.ndarray,
                    products: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Take the directions kept out of dr (T, D), where it is.

        size, scale, along : (T,) dr·dr, r*·r* and dr·r*
        products : with the n directions, (T,) each: of r* and of the latest direction, in turns, then of dr
        Returns c : (T, n) what has been taken out; and dr·dr and dr·r* of what is left, (T,)
        """
        n, steps = len(self.directions), len(dr)
        met, last, first = (np.reshape(x, (n, steps)).T for x in (products[: 2 * n : 2], products[1 : 2 * n : 2], products[2 * n : 3 * n]))
        if self.tilted is None:
            self.tilted = np.zeros((steps, 0, 0))
        if n:
            self._measured(last)
        c, norm = self._projected(first, size)
        along = along - (c * met).sum(axis=1)
        self._without(dr, c)
        if not ((norm < AGAIN * size) & (scale > 0)).any():
            return c, norm, along
        size, along, *products = self.team.sum(dots(dr, dr), dots(dr, self.r), *(dots(q, dr) for q, _ in self.directions))
        more, norm = self._projected(np.reshape(products, (n, steps)).T, size)
        self._without(dr, more)
        return c + more, norm, along - (more * met).sum(axis=1)

    def _measured(self, last: np.ndarray) -> None:
        """Note the products (T, n) of the latest direction with all; where load steps had none it is zero."""
        last = last.copy()
        last[:, -1] -= last[:, -1] > 0.5
        self.tilted[:, -1], self.tilted[:, :, -1] = last, last

    def _projected(self, products: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """c (T, n), and the square (T,) of what it leaves, from the products with the directions and the square."""
        c = products - np.einsum("tij,tj->ti", self.tilted, products)
        left = size - 2 * (c * products).sum(axis=1) + (c * (c + np.einsum("tij,tj->ti", self.tilted, c))).sum(axis=1)
        return c, left

    def _without(self, dr: np.ndarray, c: np.ndarray) -> None:
        """Take the directions kept, times c (T, n), out of dr."""
        for (q, _), own in zip(self.directions, c.T):
            add(dr, -own, q)

    def next(self) -> np.ndarray:
        return self.point[0] + self.relaxation * self.r / self.root
