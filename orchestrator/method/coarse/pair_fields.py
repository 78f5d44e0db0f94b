"""Affine fields of the two bodies of an interface at its node pairs, and what is summed over the pairs.

The fields U of a body are combinations of 1, x, y, z in each component. Forces therefore do work in them through
a few moments alone: with φ the monomials at a pair and the matrices A of an interface,

    T = [U₁, −U₂] = (1₃ ⊗ φ) A,     Tᵀf̂ = Aᵀ Σ f̂ ⊗ φ,     Σ Tᵀ (∂f̂/∂F) L = Aᵀ Σ (∂f̂/∂F ⊗ φ) L
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.compiled import in_parts
from orchestrator.laws.points import Answer
from orchestrator.method.coarse.kernels import carried, gathered, moved, spread, swept
from orchestrator.method.interface.pairs import Pairs

MONOMIALS = 4
AFFINE = 3 * MONOMIALS
WORTH = 1 << 13  # pairs, over which a loop takes much longer than to hand them out to a thread
SLOPES = 4  # how much longer pairs take whose slopes are summed


@dataclass
class PairFields:
    """Fields at all or some of the node pairs of a set of interfaces.

    pairs : Q of the node pairs, of I interfaces
    phi : (P, m) monomials at all P node pairs
    A : (I, 3m, 2n), components outside, from the fields of the first body, then of the second, to the monomials of T
    all_L : (P, 3, 2n) what the predicted force F changes with the fields, at all node pairs. In single precision: reading it
        is what a sum over pairs costs, and a correction whose forces are off by a ten-millionth corrects as well
    bodies : (I, 2) int
    chosen : (Q,) int, ascending, which ``pairs`` are; default: all
    turned : (I, 2n, 3m) A transposed, in the precision of ``all_L``
    """

    pairs: Pairs
    phi: np.ndarray
    A: np.ndarray
    all_L: np.ndarray
    bodies: np.ndarray
    chosen: np.ndarray | None = None
    turned: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.chosen is None:
            self.chosen = np.arange(len(self.phi))
        if self.turned is None:
            self.turned = np.ascontiguousarray(self.A.swapaxes(1, 2), self.all_L.dtype)

    def some(self, chosen: np.ndarray) -> PairFields:
        """The same fields at some of the pairs (R,) int, ascending."""
        return replace(self, pairs=self.pairs.some(chosen), chosen=self.chosen[chosen])

    def with_springs(self, pairs: Pairs) -> PairFields:
        """The same fields at the same pairs, whose springs of stabilisation may be others."""
        result = copy(self)
        result.pairs = pairs
        return result

    def part(self, pairs: int) -> int:
        """How many interfaces are worth a thread's while, that have so many pairs in all."""
        return max(1, len(self.bodies) * WORTH // max(1, pairs))

    @property
    def size(self) -> int:
        """Fields of a body."""
        return self.all_L.shape[2] // 2

    @property
    def L(self) -> np.ndarray:
        """(Q, 3, 2n) what the predicted force F changes with the fields."""
        return self.all_L if len(self.chosen) == len(self.all_L) else self.all_L[self.chosen]

    @property
    def _of(self) -> tuple[np.ndarray, ...]:
        """Fields and pairs as loops take them."""
        return self.all_L, self.phi, self.A, self.chosen, self.pairs.bounds

    def predicted(self, F0: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(3, Q) F₀ + L y of the fields y (bodies, n)."""
        F = np.array(F0, order="C")
        in_parts(spread, len(self.bodies), self.all_L, self.chosen, self.pairs.bounds, self.both(y), F, part=self.part(len(self.chosen)))
        return F

    def jump(self, y: np.ndarray) -> np.ndarray:
        """(3, Q) T y, what the first body moves in the fields y (bodies, n), less what the second one does."""
        result = np.empty((3, len(self.chosen)))
        combined = np.matmul(self.A, self.both(y)[:, :, None])[:, :, 0]
        in_parts(moved, len(self.bodies), self.phi, self.chosen, self.pairs.bounds, combined, result, part=self.part(len(self.chosen)))
        return result

    def swept(self, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, Q) L y and ω T y of the fields y (bodies, n); ω (P,) of all node pairs."""
        change, against = np.empty((2, 3, len(self.chosen)))
        in_parts(swept, len(self.bodies), self._of, self.bodies, np.ascontiguousarray(y), weight, (change, against),
                 part=self.part(len(self.chosen)))
        return change, against

    def both(self, y: np.ndarray) -> np.ndarray:
        """(I, 2n) fields of the two bodies of every interface."""
        return y[self.bodies].reshape(-1, 2 * self.size)

    def carried(self, force: np.ndarray, weight: np.ndarray, bodies: int) -> np.ndarray:
        """(bodies, n) ΣTᵀ ω f̂ of forces (3, Q).

        weight : (P,) ω of all node pairs
        """
        each, result = np.empty((len(self.A), 2, self.size)), np.zeros((bodies, self.size))
        in_parts(carried, len(each), self._of, np.ascontiguousarray(force), weight, each, part=self.part(len(self.chosen)))
        gathered(self.bodies, each, result)
        return result

    def slopes(self, answer: Answer, weight: np.ndarray) -> np.ndarray:
        """(I, 2, 2, n, n) ΣTᵀ ω (∂f̂/∂F) L, blocks of the two bodies, in L's precision; ω as for ``carried``."""
        from orchestrator.method.coarse.products import PRODUCT, slopes

        result = np.empty((len(self.A), 2, 2, self.size, self.size), self.all_L.dtype)
        first = np.searchsorted(answer.active, self.pairs.bounds)
        of, given = (self.phi, self.all_L, self.chosen, self.turned), (answer.active, first, np.ascontiguousarray(answer.derivative))
        in_parts(slopes, len(result), PRODUCT[self.all_L.dtype], of, given, weight, result, part=self.part(SLOPES * len(answer.active)))
        self._collective(answer, weight, result)
        return result

    def _collective(self, answer: Answer, weight: np.ndarray, slopes: np.ndarray) -> None:
        """Adds what pairs that answer together change, a product of two vectors per group."""
        if answer.collective is None:
            return
        for at, given, taken in answer.collective.groups():
            i = int(np.searchsorted(self.pairs.bounds, at[0], side="right")) - 1
            column = np.einsum("pif,ip->f", self.some(at).at_pairs(), given * weight[self.chosen[at]])
            row = np.einsum("ip,pif->f", taken, self.all_L[self.chosen[at]])
            slopes[i] -= np.outer(column, row).reshape(2, self.size, 2, self.size).swapaxes(1, 2)

    def at_pairs(self) -> np.ndarray:
        """(Q, 3, 2n) T."""
        A = np.repeat(self.A.reshape(len(self.A), 3, -1, 2 * self.size), np.diff(self.pairs.bounds), axis=0)
        return np.einsum("pm,pimf->pif", self.phi[self.chosen], A)


class DenseFields(PairFields):
    """Fields at points of which some have no pair of nodes: T = [G₁U₁, −G₂U₂] as it is, in dense products.

    A rigid link takes the turn of the master's facets along, so that fields affine on the bodies are not combinations of
    1, x, y, z at the points; and the forces are in balance at the end only if T is exact.

    T : (P, 3, 2n); all_L, bodies : as for ``PairFields``
    """

    def __init__(self, pairs: Pairs, T: np.ndarray, all_L: np.ndarray, bodies: np.ndarray, chosen: np.ndarray | None = None):
        super().__init__(pairs, np.empty((len(T), 0)), np.empty((len(bodies), 0, all_L.shape[2])), all_L, bodies, chosen)
        self.T = T

    def some(self, chosen: np.ndarray) -> DenseFields:
        """As for ``PairFields``."""
        return DenseFields(self.pairs.some(chosen), self.T, self.all_L, self.bodies, self.chosen[chosen])

    def jump(self, y: np.ndarray) -> np.ndarray:
        """(3, Q) T y."""
        result = np.zeros((3, len(self.chosen)))
        in_parts(spread, len(self.bodies), self.T, self.chosen, self.pairs.bounds, self.both(y), result, part=self.part(len(self.chosen)))
        return result

    def swept(self, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As for ``PairFields``."""
        return self.predicted(np.zeros((3, len(self.chosen))), y), self.jump(y) * weight[self.chosen]

    def carried(self, force: np.ndarray, weight: np.ndarray, bodies: int) -> np.ndarray:
        """As for ``PairFields``."""
        result, weighted = np.zeros((bodies, self.size)), (force * weight[self.chosen]).T
        for i, part in self._parts(np.arange(len(self.chosen))):
            both = np.tensordot(weighted[part], self.T[self.chosen[part]], axes=2).reshape(2, self.size)
            for body, own in zip(self.bodies[i], both):
                result[body] += own
        return result

    def slopes(self, answer: Answer, weight: np.ndarray) -> np.ndarray:
        """As for ``PairFields``."""
        result = np.zeros((len(self.bodies), 2, 2, self.size, self.size))
        for i, part in self._parts(answer.active):
            at = self.chosen[answer.active[part]]
            turned = answer.derivative[:, :, part].transpose(2, 0, 1) * weight[at, None, None] @ self.all_L[at]
            whole = self.T[at].reshape(-1, 2 * self.size).T @ turned.reshape(-1, 2 * self.size)
            result[i] = whole.reshape(2, self.size, 2, self.size).swapaxes(1, 2)
        self._collective(answer, weight, result)
        return result

    def at_pairs(self) -> np.ndarray:
        """(Q, 3, 2n) T."""
        return self.T[self.chosen]

    def _parts(self, points: np.ndarray) -> Iterator[tuple[int, slice]]:
        """Interfaces that have some of the points (R,) int, ascending, and which of them these are."""
        ends = np.searchsorted(points, self.pairs.bounds)
        for i in np.flatnonzero(np.diff(ends)):
            yield int(i), slice(int(ends[i]), int(ends[i + 1]))
