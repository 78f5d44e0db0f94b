"""Affine fields of the two bodies of an interface at its node pairs, and what is summed over the pairs.

The fields U of a body are combinations of 1, x, y, z in each component. Forces therefore do work in them through
a few moments alone: with φ the monomials at a pair and the matrices A of an interface,

    T = [U₁, −U₂] = (1₃ ⊗ φ) A,     Tᵀf̂ = Aᵀ Σ f̂ ⊗ φ,     Σ Tᵀ (∂f̂/∂F) L = Aᵀ Σ (∂f̂/∂F ⊗ φ) L
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Answer
from orchestrator.method.interface.pairs import Pairs

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
    L : (P, 3, 24) what the predicted force F changes with the fields
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
        both, L = self.both(y), self.L.reshape(-1, 2 * FIELDS)
        result = np.empty(len(L))
        for v, a, b in self._each(both, 3):
            np.dot(L[a:b], v, out=result[a:b])
        return result.reshape(-1, 3).T

    def both(self, y: np.ndarray) -> np.ndarray:
        """(I, 24) fields of the two bodies of every interface."""
        return y[self.bodies].reshape(-1, 2 * FIELDS)

    def carried(self, force: np.ndarray) -> np.ndarray:
        """(I, 24) Tᵀf̂ of forces (3, P)."""
        moments = (self._moments @ force.T).reshape(len(self.A), -1, 3).swapaxes(1, 2)
        return np.einsum("iaf,ia->if", self.A, moments.reshape(len(self.A), -1))

    def slopes(self, answer: Answer) -> np.ndarray:
        """(I, 24, 24) ΣTᵀ (∂f̂/∂F) L."""
        count, m = self.phi.shape
        slope = np.zeros((3, 3, count))
        slope[:, :, answer.active] = answer.derivative
        weights = (slope[:, None] * self._phi_rows[:, None]).reshape(3 * m, 3, count)
        weights = np.ascontiguousarray(weights.transpose(2, 1, 0)).reshape(3 * count, 3 * m)
        L = self.L.reshape(-1, 2 * FIELDS)
        sums = np.zeros((len(self.A), 3 * m, 2 * FIELDS))
        for s, a, b in self._each(sums, 3):
            np.dot(weights[a:b].T, L[a:b], out=s)
        return self.A.swapaxes(1, 2) @ sums

    def at_pairs(self) -> np.ndarray:
        """(P, 3, 24) T."""
        A = np.repeat(self.A.reshape(len(self.A), 3, -1, 2 * FIELDS), np.diff(self.pairs.bounds), axis=0)
        return np.einsum("pm,pimf->pif", self.phi, A)

    @cached_property
    def normal_size(self) -> np.ndarray:
        """(P,) Euclidean norm of n·L: the most that the normal force changes with fields of that size."""
        along = np.einsum("ip,pif->pf", self.pairs.points.normal, self.L)
        return np.linalg.norm(along, axis=1)

    @cached_property
    def _moments(self) -> sp.csc_array:
        """(I m, P) sums over the pairs of each interface, weighted with φ; a column is a pair."""
        count, m = self.phi.shape
        interface = np.repeat(np.arange(len(self.A)), np.diff(self.pairs.bounds))
        rows = m * interface[:, None] + np.arange(m)
        return sp.csc_array((self.phi.ravel(), rows.ravel(), m * np.arange(count + 1)), shape=(m * len(self.A), count))

    @cached_property
    def _phi_rows(self) -> np.ndarray:
        return np.ascontiguousarray(self.phi.T)

    def _each(self, values: np.ndarray, rows: int):
        """Per interface that has pairs: its entry of the values, its first and last row."""
        bounds = (rows * self.pairs.bounds).tolist()
        return ((v, a, b) for v, a, b in zip(values, bounds[:-1], bounds[1:]) if b > a)
