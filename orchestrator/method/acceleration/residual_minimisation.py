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

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.method.interface.rows import add, dots
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.memory import INTERVAL, Memory
from orchestrator.parallel.team import ALONE, Team

_NAMES = [("trace", "r"), ("trace", "s"), ("boundary", "u"), ("macro", "alpha")]
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

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, float], int]:
        """The last evaluation."""
        return {"trace/s": self.s, "trace/residual": self.residual}, {}, 1

    def recall(self, memories: Sequence[Memory]) -> None:
        """Take the last evaluation back."""
        arrays = memories[-1].arrays
        self.s, self.residual = arrays["trace/s"], arrays["trace/residual"]

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
        self.gamma, self.taken = np.zeros(0), 0

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
            steps = np.zeros((len(self.directions), len(dr)))
            # all products at once: one message among the ranks for each pass, of which twice is enough
            size, scale, *first = self.team.sum(dots(dr, dr), dots(self.r, self.r), *(dots(q, dr) for q, _ in self.directions))
            self._without(dr, first, steps)
            norm, along, *products = self.team.sum(dots(dr, dr), dots(dr, self.r),
                                                   *(f(q) for q, _ in self.directions
                                                     for f in (lambda q: dots(q, dr), lambda q: dots(q, self.r))))
            second, met = products[::2], products[1::2]
            self._without(dr, second, steps)
            # by Pythagoras: what the second pass takes away is rounding of the first
            norm = norm - sum((c * c for c in second), np.zeros(len(dr)))
            along = along - sum((c * m for c, m in zip(second, met)), np.zeros(len(dr)))
            for (_, p), c in zip(self.directions, steps):
                for a, b in zip(dp, p):
                    add(a, -c, b)
            norm, size = np.sqrt(np.maximum(norm, 0.0)), np.sqrt(size)
            good = (norm > DEPENDENT * size) & (scale > 0)
            inverse = np.where(good, 1 / np.where(good, norm, 1), 0.0)
            dr *= inverse[:, None]
            for a in dp:
                a *= inverse[:, None]
            self.directions.append((dr, dp))
            if self.memory is not None and len(self.directions) > self.memory:
                self.directions.pop(0)
            self.gamma = -along * inverse
            self._step(dr, dp)
            best = self.complete(*self.point)
        self.taken += 1
        return self.r / self.root, best

    def _without(self, dr: np.ndarray, products: list[np.ndarray], steps: np.ndarray) -> None:
        """Take the directions kept out of dr, by its products with them (T,), and note these in the steps."""
        for (q, _), c in zip(self.directions, products):
            add(dr, -c, q)
        steps += np.reshape(products, steps.shape)

    def _step(self, dr: np.ndarray, dp: list[np.ndarray]) -> None:
        """From the best point along a direction, by γ."""
        gamma = self.gamma[:, None]
        self.r = self.r + dr * gamma
        self.point = [a + b * gamma for a, b in zip(self.point, dp)]

    def told(self, whole: bool) -> tuple[dict[str, np.ndarray], dict[str, object], int]:
        """The last direction and the step along it; as a whole also the point that this has led to.

        Notes
        -----
        All directions that are kept have to be known, and a point to begin from.
        """
        arrays, gamma = {}, []
        if self.directions:
            dr, dp = self.directions[-1]
            arrays, gamma = _named("d", dr, dp), self.gamma.tolist()
        if whole or not self.directions:
            arrays |= _named("", self.r, self.point)
        back = self.taken if self.memory is None else min(self.taken, max(self.memory, INTERVAL))
        return arrays, {"gamma": gamma, "directions": len(self.directions), "taken": self.taken}, back

    def recall(self, memories: Sequence[Memory]) -> None:
        """Take the directions back, and the steps since the first point that is known."""
        for memory in memories:
            arrays, notes = memory.arrays, memory.notes["acceleration"]
            if notes["gamma"]:
                dr, *dp = (arrays[f"{kind}/d{name}"] for kind, name in _NAMES)
                self.directions.append((dr, dp))
                self.gamma = np.array(notes["gamma"])
            if "trace/r" in arrays:
                self.r, *self.point = (arrays[f"{kind}/{name}"] for kind, name in _NAMES)
            elif self.r is not None:
                self._step(dr, dp)
        self.taken = notes["taken"]
        del self.directions[: len(self.directions) - notes["directions"]]

    def next(self) -> np.ndarray:
        """State to evaluate next."""
        return self.point[0] + self.relaxation * self.r / self.root


def _named(prefix: str, r: np.ndarray, point: list[np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{kind}/{prefix}{name}": array for (kind, name), array in zip(_NAMES, [r, *point])}
