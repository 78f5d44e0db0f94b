"""Matrices of many bodies in affine fields: rigid motions eliminated, stretches found by GMRES.

Bodies resist being stretched far more than their neighbours let them feel, so that the rigid
motions, the first half of a body's fields, carry nearly all that goes from body to body. They are
eliminated, so that loose bodies, whose stiffness is a millionth of others', are solved for exactly;
what is left,

    (A₂₂ − A₂₁ A₁₁⁻¹ A₁₂) x₂ = r₂ − A₂₁ A₁₁⁻¹ r₁,     x₁ = A₁₁⁻¹ (r₁ − A₁₂ x₂)

is close to each body's own block B of A₂₂, with which GMRES (Saad & Schultz, SIAM J. Sci. Stat.
Comput. 7, 1986) is preconditioned. Half of the rows in the fronts are an eighth of the operations.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import gmres, LinearOperator

from orchestrator.method.sparse.fronts import Elimination

MOST = 40  # steps, after which what has been found is taken: it is searched along as any step is


class RigidFirst:
    """A matrix that can be solved with.

    of : order and fronts of its first rows
    values : (k, size, size) its blocks, in the order of the pattern; shift : of its diagonal
    diagonal : (bodies,) int, which of them are bodies' own
    """

    def __init__(self, of: Elimination, values: np.ndarray, shift: float, diagonal: np.ndarray):
        cuts = slice(0, of.size), slice(of.size, None)
        first, *parts = (values[:, b, c] for b, c in product(cuts, cuts))
        self.rigid = of.factors(first, shift)
        stretch = shift * np.eye(parts[2].shape[1])
        parts[2] = parts[2].copy()
        parts[2][diagonal] += stretch
        self.stretch = np.linalg.inv(parts[2][diagonal])
        self.first, self.second, self.third = (sp.bsr_array((part, of.indices, of.indptr))
                                               for part in parts)

    def solve(self, right: np.ndarray, enough: float = 0.1) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape.

        enough : ‖r‖ left, over that of the right-hand side: pairs that change are in the way of a
            step by far more (Eisenstat & Walker, SIAM J. Sci. Comput. 17, 1996)
        """
        r1, r2 = np.hsplit(right, [self.rigid.of.size])
        left = r2.ravel() - self.second @ self._rigid(r1)
        operator = LinearOperator((left.size,) * 2, dtype=float, matvec=lambda v: self._times(
            self._stretched(v)))
        v, _ = gmres(operator, left, rtol=0.0, atol=enough * np.linalg.norm(right), restart=MOST,
                     maxiter=1)
        x2 = self._stretched(v)
        x1 = self._rigid(r1.ravel() - self.first @ x2)
        return np.hstack([x1.reshape(r1.shape), x2.reshape(r2.shape)])

    def _times(self, x: np.ndarray) -> np.ndarray:
        """(A₂₂ − A₂₁ A₁₁⁻¹ A₁₂) x."""
        return self.third @ x - self.second @ self._rigid(self.first @ x)

    def _rigid(self, r: np.ndarray) -> np.ndarray:
        """A₁₁⁻¹ r, flat."""
        return self.rigid.solve(r.reshape(-1, self.rigid.of.size)).ravel()

    def _stretched(self, v: np.ndarray) -> np.ndarray:
        """B⁻¹ v, flat."""
        return np.einsum("bij,bj->bi", self.stretch, v.reshape(len(self.stretch), -1)).ravel()
