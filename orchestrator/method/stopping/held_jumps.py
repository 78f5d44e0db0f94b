"""Jumps that laws hold while admissible displacements are sought, and how they give way for their
price.

What is held pulls with a force y, and laws charge γ(d, λ̂) for a jump that gives way: c |x| for a
pair that goes by x, p g where it opens, (μ p − |τ|) |Δ| and more where it slips. To hold it costs
more where |y| > c. Such a pair, and one that is at odds with others at its node, gives way softly,
by |x|/c under a unit force: once x is known it pulls with c (iteratively reweighted least squares).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from orchestrator.method.interface.rows import ratio

ALONG = 0.5  # cosine to the normal: directions are along it or across


@dataclass(frozen=True)
class Charges:
    """Price that the laws of one load step put on jumps (3, P), beside λ̂.

    charge : jumps → (P,) γ; broken : jumps → (b,) int, pairs where they break what has no price
    normal : (3, P)
    scale, rounding : size of the jumps, and of those that count for nothing
    softest : how soft what costs nothing is
    """

    charge: Callable[[np.ndarray], np.ndarray]
    broken: Callable[[np.ndarray], np.ndarray]
    normal: np.ndarray
    scale: float
    rounding: float
    softest: float


@dataclass(frozen=True)
class HeldJumps:
    """Directions in which laws hold jumps, r of them.

    at : (r,) int, pairs; directions : (r, 3) unit vectors
    goals : (r,) what the jumps there have to be
    soft : (r,) how far they give way under a unit force
    priced : (r,) bool, whether they give way where it is cheaper
    """

    at: np.ndarray
    directions: np.ndarray
    goals: np.ndarray
    soft: np.ndarray
    priced: np.ndarray

    def some(self, chosen: np.ndarray) -> HeldJumps:
        """Those that are chosen, (r,) bool or places."""
        return HeldJumps(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def and_then(self, other: HeldJumps) -> HeldJumps:
        """These, and the others behind."""
        return HeldJumps(*(np.concatenate([getattr(held, field.name) for held in (self, other)])
                           for field in fields(self)))

    def of(self, jump: np.ndarray) -> np.ndarray:
        """(r,) jumps (3, P) in these directions."""
        return np.einsum("ri,ir->r", self.directions, jump[:, self.at])

    def along(self, normal: np.ndarray) -> np.ndarray:
        """(r,) bool, directions along the normals (3, P)."""
        return np.abs(self.of(normal)) > ALONG

    def softened(self, pulls: np.ndarray, yields: np.ndarray, jump: np.ndarray,
                 laws: Charges) -> np.ndarray:
        """(r,) how soft directions have to be, lest it cost more to hold them than to pay.

        pulls : (r,) forces that hold; yields : (r,) how far unit forces move what they hold
        jump : (3, P) as it is held
        """
        count, away = jump.shape[1], np.where(self.priced, self.of(jump) - self.goals, 0.0)
        gone = (self.soft > 0) | (np.abs(away) > laws.rounding)
        wish = np.where(self.priced, np.where(gone, away, yields * pulls), 0.0)
        kept = jump - self._jumps(away, count)
        pressed = np.isin(self.at,
                          laws.broken(kept + _as_long_as(laws.scale, self._jumps(wish, count))))
        wish = np.where(pressed & self.along(laws.normal), 0.0, wish)
        there = kept + _as_long_as(laws.scale, self._jumps(wish, count))
        price = np.maximum(laws.charge(there) - laws.charge(kept),
                           0.0)[self.at] / max(laws.scale, np.finfo(float).tiny)
        far, pull = (np.linalg.norm(self._jumps(x * (wish != 0), count), axis=0)[self.at]
                     for x in (wish, pulls))
        far = np.where(gone, far,
                       far * np.maximum(1 - price / np.maximum(pull, np.finfo(float).tiny), 0.0))
        soft = np.divide(far, price, out=np.full_like(far, laws.softest),
                         where=far < laws.softest * price)
        return np.where(self.priced, np.where((wish != 0) & (far > laws.rounding), soft, 0.0),
                        self.soft)

    def _jumps(self, sizes: np.ndarray, count: int) -> np.ndarray:
        """(3, count) sums of sizes (r,) along the directions of each pair."""
        result = np.zeros((count, 3))
        np.add.at(result, self.at, sizes[:, None] * self.directions)
        return result.T


def _as_long_as(scale: float, jump: np.ndarray) -> np.ndarray:
    """Jumps (3, P) made as long as that, but for those that are none."""
    size = np.linalg.norm(jump, axis=0)
    return ratio(scale * jump, size)
