"""Affine fields of the two bodies of an interface at its node pairs, and what is summed over the pairs.

The fields U of a body are combinations of 1, x, y, z in each component. Forces therefore do work in them through
a few moments alone: with φ the monomials at a pair and the matrices A of an interface,

    T = [U₁, −U₂] = (1₃ ⊗ φ) A,     Tᵀf̂ = Aᵀ Σ f̂ ⊗ φ,     Σ Tᵀ (∂f̂/∂F) L = Aᵀ Σ (∂f̂/∂F ⊗ φ) L
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from orchestrator.method.laws.points import Answer
from orchestrator.method.pairs import Pairs

MONOMIALS = 4
FIELDS = 3 * MONOMIALS


@dataclass
class PairFields:
    """Fields at all or some of the node pairs of a set of interfaces.

    Parameters
    ----------
    pairs : P of the node pairs, of I interfaces
    phi : (P, m) monomials
    A : (I, 3m, 24), components outside, from the fields of the first body, then of the second, to the monomials of T
    L : (P, 3, 24) single precision, what the predicted force F changes with the fields: it always multiplies
        their change, which is small in the end
    bodies : (I, 2) int
    """

    pairs: Pairs
    phi: np.ndarray
    A: np.ndarray
    L: np.ndarray
    bodies: np.ndarray

    def some(self, chosen: np.ndarray) -> PairFields:
        """The same fields at some of the pairs (Q,) int, ascending."""
        return PairFields(self.pairs.some(chosen), self.phi[chosen], self.A, self.L[chosen], self.bodies)

    def spread(self, y: np.ndarray) -> np.ndarray:
        """(3, P) L y of the fields y (bodies, 12)."""
        both, L = self.both(y).astype(np.float32), self.L.reshape(-1, 2 * FIELDS)
        result = np.empty(len(L), np.float32)
        for v, a, b in self._each(both, 3):
            np.dot(L[a:b], v, out=result[a:b])
        return result.reshape(-1, 3).T

    def both(self, y: np.ndarray) -> np.ndarray:
        """(I, 24) fields of the two bodies of every interface."""
        return y[self.bodies].reshape(-1, 2 * FIELDS)

    def carried(self, force: np.ndarray) -> np.ndarray:
        """(I, 24) Tᵀf̂ of forces (3, P)."""
        moments = np.zeros((len(self.A), 3, self.phi.shape[1]))
        for m, a, b in self._each(moments, 1):
            np.dot(force[:, a:b], self.phi[a:b], out=m)
        return np.einsum("iaf,ia->if", self.A, moments.reshape(len(self.A), -1))

    def slopes(self, answer: Answer) -> np.ndarray:
        """(I, 24, 24) ΣTᵀ (∂f̂/∂F) L, single precision: a Newton matrix need not be better than its step."""
        count, m = self.phi.shape
        weights = np.zeros((count, 3, 3, m), np.float32)
        slope = np.ascontiguousarray(answer.derivative.transpose(2, 1, 0), dtype=np.float32)
        weights[answer.active] = slope[:, :, :, None] * self._phi_single[answer.active][:, None, None, :]
        weights, L = weights.reshape(3 * count, 3 * m), self.L.reshape(-1, 2 * FIELDS)
        sums = np.zeros((len(self.A), 3 * m, 2 * FIELDS), np.float32)
        for s, a, b in self._each(sums, 3):
            np.dot(weights[a:b].T, L[a:b], out=s)
        return self._A_single @ sums

    def at_pairs(self) -> np.ndarray:
        """(P, 3, 24) T."""
        A = np.repeat(self.A.reshape(len(self.A), 3, -1, 2 * FIELDS), np.diff(self.pairs.bounds), axis=0)
        return np.einsum("pm,pimf->pif", self.phi, A)

    @cached_property
    def normal_size(self) -> np.ndarray:
        """(P,) Euclidean norm of n·L: the most that the normal force changes with fields of that size."""
        along = np.einsum("ip,pif->pf", self.pairs.points.normal.astype(np.float32), self.L)
        return np.linalg.norm(along, axis=1)

    @cached_property
    def _phi_single(self) -> np.ndarray:
        return self.phi.astype(np.float32)

    @cached_property
    def _A_single(self) -> np.ndarray:
        return np.ascontiguousarray(self.A.transpose(0, 2, 1), dtype=np.float32)

    def _each(self, values: np.ndarray, rows: int):
        """Per interface that has pairs: its entry of the values, its first and last row."""
        bounds = (rows * self.pairs.bounds).tolist()
        return ((v, a, b) for v, a, b in zip(values, bounds[:-1], bounds[1:]) if b > a)
