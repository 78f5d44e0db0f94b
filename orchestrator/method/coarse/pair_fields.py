"""Fields of the two bodies of an interface at its points, and what is summed over the points.

The fields U of a body are combinations of 1, x, y, z in each component. What both bodies move at
the points of an interface, T = [G₁U₁, −G₂U₂], has therefore few shapes φ, and forces do work in it
through a few moments alone:

    T = (1₃ ⊗ φ) A,     Tᵀf̂ = Aᵀ Σ f̂ ⊗ φ,     Σ Tᵀ (∂f̂/∂F) L = Aᵀ Σ (∂f̂/∂F ⊗ φ) L

φ are singular vectors of T: four where nodes match, some more where sides are apart, components are
prescribed or a link takes the turn of facets along, as many as there are points where a body moves
in modes of its own.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import in_parts
from orchestrator.laws.points import Answer
from orchestrator.method.coarse.kernels import carried, moved, slopes, spread
from orchestrator.method.interface.pairs import Pairs
from orchestrator.scene.interface import ends_of
from orchestrator.linalg import svd

# singular value of T, over the largest, that is rounding: forces are in balance at the end only if
# T is exact
EXACT = 1e-13
WORTH = 1 << 13  # pairs, over which a loop takes much longer than to hand them out to a thread
SLOPES = 4  # how much longer pairs take whose slopes are summed


@dataclass
class PairFields:
    """Fields at all or some of the node pairs of a set of interfaces.

    pairs : Q of the points, of I interfaces
    phi : shapes φ at all P points, as many numbers of each as its interface has ``shapes`` (I,) m:
        those of p begin at ``places`` (I,) + m p
    A : (R, 2n), for each interface 3m rows, components outside, from ``rows`` (I,) on: from the
        fields of the first body, then of the second, to the shapes of T
    all_L : (P, 3, 2n) what the predicted force F changes with the fields, at all points. In single
        precision: reading it is what a sum over points costs, and a correction whose forces are off
        by a ten-millionth corrects as well
    ends : (I, 2) int, the two bodies of each interface, of ``count`` of all ranks
    chosen : (Q,) int, ascending, which ``pairs`` are; default: all
    single : A in the precision of ``all_L``
    """

    pairs: Pairs
    phi: np.ndarray
    places: np.ndarray
    A: np.ndarray
    rows: np.ndarray
    shapes: np.ndarray
    all_L: np.ndarray
    ends: np.ndarray
    count: int
    chosen: np.ndarray | None = None
    single: np.ndarray | None = None

    @classmethod
    def of(cls, pairs: Pairs, T: np.ndarray, L: np.ndarray, count: int) -> PairFields:
        """From T and L (P, 3, 2n)."""
        # none of no interface
        width, bounds, phi, A = T.shape[2], pairs.bounds, [np.zeros(0)], [np.zeros((0, T.shape[2]))]
        for a, b in zip(bounds[:-1], bounds[1:]):
            shapes, size, mixed = svd(T[a:b].reshape(b - a, 3 * width), full_matrices=False)
            kept = int((size > EXACT * size.max(initial=0.0)).sum())
            phi.append(shapes[:, :kept].ravel())
            A.append(
                (size[:kept, None] * mixed[:kept]).reshape(-1, 3,
                                                           width).swapaxes(0, 1).reshape(-1, width))
        shapes = np.array([len(each) // 3 for each in A[1:]], int)
        places = np.cumsum([len(each) for each in phi])[:-1] - shapes * bounds[:-1]
        return cls(pairs, np.concatenate(phi), places, np.concatenate(A),
                   3 * (np.cumsum(shapes) - shapes), shapes,
                   np.ascontiguousarray(L, dtype=np.float32), ends_of(pairs.interfaces), count)

    def __post_init__(self) -> None:
        if self.chosen is None:
            self.chosen = np.arange(len(self.all_L))
        if self.single is None:
            self.single = self.A.astype(self.all_L.dtype)

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
        return max(1, len(self.ends) * WORTH // max(1, pairs))

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
        return (
            self.all_L, self.phi, self.places, self.A, self.rows, self.shapes, self.chosen,
            self.pairs.bounds)

    def predicted(self, F0: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(3, Q) F₀ + L y of the fields y (bodies, n)."""
        F = np.array(F0, order="C")
        in_parts(spread, len(self.ends), self.all_L, self.chosen, self.pairs.bounds, self.both(y),
                 F, part=self.part(len(self.chosen)))
        return F

    def swept(self, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, Q) L y and ω T y of the fields y (bodies, n); ω (P,) of all node pairs."""
        against = np.empty((3, len(self.chosen)))
        in_parts(moved, len(self.ends), self._of, self.both(y), weight, against,
                 part=self.part(len(self.chosen)))
        return self.predicted(np.zeros_like(against), y), against

    def both(self, y: np.ndarray) -> np.ndarray:
        """(I, 2n) fields of the two bodies of every interface."""
        return y[self.ends].reshape(-1, 2 * self.size)

    def carried(self, force: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(bodies, n) ΣTᵀ ω f̂ of forces (3, Q).

        weight : (P,) ω of all points
        """
        each = np.empty((len(self.ends), 2, self.size))
        in_parts(carried, len(each), self._of, np.ascontiguousarray(force), weight, each,
                 part=self.part(len(self.chosen)))
        return self._sums @ each.reshape(-1, self.size)

    @cached_property
    def _sums(self) -> sp.csr_array:
        """(bodies, 2I) 0/1, what interfaces bring their bodies."""
        sides = self.ends.size
        return sp.csr_array((np.ones(sides), (self.ends.ravel(), np.arange(sides))),
                            shape=(self.count, sides))

    def slopes(self, answer: Answer, weight: np.ndarray) -> np.ndarray:
        """(I, 2, 2, n, n) ΣTᵀ ω (∂f̂/∂F) L, blocks of the two bodies, in L's precision; ω as for
        ``carried``.
        """
        result = np.empty((len(self.ends), 2, 2, self.size, self.size), self.all_L.dtype)
        given = answer.active, np.searchsorted(
            answer.active, self.pairs.bounds), np.ascontiguousarray(answer.derivative)
        in_parts(slopes, len(result), self._of, self.single, given, weight, result,
                 part=self.part(SLOPES * len(answer.active)))
        self._collective(answer, weight, result)
        return result

    def _interface(self, at: np.ndarray) -> int:
        """The one that points are of."""
        return int(np.searchsorted(self.pairs.bounds, at[0], side="right")) - 1

    def _collective(self, answer: Answer, weight: np.ndarray, result: np.ndarray) -> None:
        """Adds what pairs that answer together change, a product of two vectors per group."""
        if answer.collective is None:
            return
        for at, given, taken in answer.collective.groups():
            i = self._interface(at)
            column = np.einsum("pif,ip->f", self.some(at).T, given * weight[self.chosen[at]])
            row = np.einsum("ip,pif->f", taken, self.all_L[self.chosen[at]])
            result[i] -= np.outer(column, row).reshape(2, self.size, 2, self.size).swapaxes(1, 2)

    @property
    def T(self) -> np.ndarray:
        """(Q, 3, 2n), zero in components that are prescribed."""
        result, bounds = np.empty((len(self.chosen), 3, 2 * self.size)), self.pairs.bounds
        for a, b, row, m, place in zip(bounds[:-1], bounds[1:], self.rows, self.shapes,
                                       self.places):
            phi = self.phi[place + m * self.chosen[a:b, None] + np.arange(m)]
            result[a:b] = np.einsum("pm,imf->pif", phi,
                                    self.A[row : row + 3 * m].reshape(3, m, 2 * self.size))
        return result
