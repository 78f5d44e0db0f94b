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

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import in_parts
from orchestrator.laws.points import Collective
from orchestrator.method.coarse.kernels import carried, slopes, spread
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
    """Fields at the node pairs of a set of interfaces.

    pairs : P points, of I interfaces
    phi : shapes φ at all points, as many numbers of each as its interface has ``shapes`` (I,) m:
        those of p begin at ``places`` (I,) + m p
    A : (R, 2n), for each interface 3m rows, components outside, from ``rows`` (I,) on: from the
        fields of the first body, then of the second, to the shapes of T
    L : (P, 3, 2n) what the predicted force F changes with the fields. In single precision: reading
        it is what a sum over points costs, and a correction whose forces are off by a ten-millionth
        corrects as well
    ends : (I, 2) int, the two bodies of each interface, of ``count`` of all ranks
    """

    pairs: Pairs
    phi: np.ndarray
    places: np.ndarray
    A: np.ndarray
    rows: np.ndarray
    shapes: np.ndarray
    L: np.ndarray
    ends: np.ndarray
    count: int

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

    @cached_property
    def single(self) -> np.ndarray:
        """A in the precision of L."""
        return self.A.astype(self.L.dtype)

    def part(self, pairs: int) -> int:
        """How many interfaces are worth a thread's while, that have so many pairs in all."""
        return max(1, len(self.ends) * WORTH // max(1, pairs))

    @property
    def size(self) -> int:
        """Fields of a body."""
        return self.L.shape[2] // 2

    @property
    def _of(self) -> tuple[np.ndarray, ...]:
        """Fields and pairs as loops take them."""
        return (self.L, self.phi, self.places, self.A, self.rows, self.shapes, self.pairs.bounds)

    def predicted(self, F0: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(3, P) F₀ + L y of the fields y (bodies, n)."""
        F = np.array(F0, order="C")
        in_parts(spread, len(self.ends), self.L, self.pairs.bounds, self.both(y), F,
                 part=self.part(len(self.L)))
        return F

    def both(self, y: np.ndarray) -> np.ndarray:
        """(I, 2n) fields of the two bodies of every interface."""
        return y[self.ends].reshape(-1, 2 * self.size)

    def carried(self, force: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(bodies, n) ΣTᵀ ω f̂ of forces (3, P).

        weight : (P,) ω of all points
        """
        each = np.empty((len(self.ends), 2, self.size))
        in_parts(carried, len(each), self._of, np.ascontiguousarray(force), weight, each,
                 part=self.part(len(self.L)))
        return self._sums @ each.reshape(-1, self.size)

    @cached_property
    def _sums(self) -> sp.csr_array:
        """(bodies, 2I) 0/1, what interfaces bring their bodies."""
        sides = self.ends.size
        return sp.csr_array((np.ones(sides), (self.ends.ravel(), np.arange(sides))),
                            shape=(self.count, sides))

    def slopes(self, slope: np.ndarray, collective: Collective | None,
               weight: np.ndarray) -> np.ndarray:
        """(I, 2, 2, n, n) ΣTᵀ ω (∂f̂/∂F) L, blocks of the two bodies, in L's precision; ω as for
        ``carried``.

        slope : (3, 3, P) ∂f̂/∂F; collective : what pairs that answer together change besides
        """
        result = np.empty((len(self.ends), 2, 2, self.size, self.size), self.L.dtype)
        active, bounds = np.flatnonzero(slope.any(axis=(0, 1))), self.pairs.bounds
        given = active, np.searchsorted(active, bounds), slope[:, :, active]
        in_parts(slopes, len(result), self._of, self.single, given, weight, result,
                 part=self.part(SLOPES * len(active)))
        for at, taking, taken in () if collective is None else collective.groups():
            i = int(np.searchsorted(bounds, at[0], side="right")) - 1
            column = np.einsum("pif,ip->f", self.T(at), taking * weight[at])
            row = np.einsum("ip,pif->f", taken, self.L[at])
            result[i] -= np.outer(column, row).reshape(2, self.size, 2, self.size).swapaxes(1, 2)
        return result

    def T(self, at: np.ndarray) -> np.ndarray:
        """(Q, 3, 2n) at some points (Q,) int, ascending; zero in components that are prescribed."""
        result, bounds = np.empty((len(at), 3, 2 * self.size)), self.pairs.bounds
        ends = np.searchsorted(at, bounds)
        for a, b, row, m, place in zip(ends[:-1], ends[1:], self.rows, self.shapes, self.places):
            phi = self.phi[place + m * at[a:b, None] + np.arange(m)]
            result[a:b] = np.einsum("pm,imf->pif", phi,
                                    self.A[row : row + 3 * m].reshape(3, m, 2 * self.size))
        return result
