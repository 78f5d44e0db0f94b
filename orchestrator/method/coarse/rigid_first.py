"""Newton's matrices of many bodies in affine fields: rigid motions eliminated, stretches found by
GMRES.

Bodies resist being stretched far more than their neighbours let them feel, so that the rigid
motions, the first half of a body's fields, carry nearly all that goes from body to body. They are
eliminated, so that loose bodies, whose stiffness is a millionth of others', are solved for exactly;
what is left,

    (A₂₂ − A₂₁ A₁₁⁻¹ A₁₂) x₂ = r₂ − A₂₁ A₁₁⁻¹ r₁,     x₁ = A₁₁⁻¹ (r₁ − A₁₂ x₂)

is close to each body's own block B of A₂₂, with which GMRES (Saad & Schultz, SIAM J. Sci. Stat.
Comput. 7, 1986) is preconditioned. Half of the rows in the fronts are an eighth of the operations.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.coarse.elimination import Factors
from orchestrator.parallel.team import Team

# ‖r‖ left, over that of the right-hand side: pairs that change are in the way of a step by far more
# (Eisenstat & Walker, SIAM J. Sci.
# Comput. 17, 1996)
ENOUGH = 0.1
MOST = 40  # steps, after which what has been found is taken: it is searched along as any step is


class RigidFirst:
    """A matrix that can be solved with.

    rigid : factors of A₁₁
    first, second, third : A₁₂, A₂₁ and A₂₂, the parts of them that this rank has
    own : (bodies, m, m) the last rows of its diagonal blocks
    """

    def __init__(self, rigid: Factors, parts: tuple[sp.bsr_array, sp.bsr_array, sp.bsr_array],
                 own: np.ndarray, team: Team):
        self.rigid, (self.first, self.second, self.third), self.team = rigid, parts, team
        self.stretch = np.linalg.inv(team.sum(own)[0])

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape, which all ranks have; on all
        ranks.
        """
        size = self.rigid.of.size
        x1 = self.rigid.solve(right[:, :size])
        left = (right[:, size:] - self._sum(self.second, x1)).ravel()
        goal, norm, basis = ENOUGH * np.linalg.norm(right), np.linalg.norm(left), np.zeros(
            (MOST + 1, left.size))
        found, H, start = [], np.zeros((MOST + 1, MOST)), np.zeros(MOST + 1)
        basis[0], start[0] = left / norm if norm > 0 else left, norm
        for k in range(MOST):
            new, *each = self._times(basis[k].reshape(len(right), -1))
            found.append(each)
            for _ in range(2):  # once more for what rounding has left
                part = basis[: k + 1] @ new
                H[: k + 1, k] += part
                new = new - part @ basis[: k + 1]
            H[k + 1, k] = np.linalg.norm(new)
            y = np.linalg.lstsq(H[: k + 2, : k + 1], start[: k + 2])[0]
            if np.linalg.norm(start[: k + 2] - H[: k + 2, : k + 1]
                              @ y) <= goal or not H[k + 1, k] > 0:
                break
            basis[k + 1] = new / H[k + 1, k]
        x1, x2 = x1 + sum(a * one for a, (one, _) in zip(y, found)), sum(
            a * two for a, (_, two) in zip(y, found))
        return np.hstack([x1, x2])

    def _times(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(A₂₂ − A₂₁ A₁₁⁻¹ A₁₂) B⁻¹ v, and what it has of rigid motions and stretches, −A₁₁⁻¹ A₁₂
        B⁻¹ v and B⁻¹ v.
        """
        x2 = np.einsum("bij,bj->bi", self.stretch, v)
        x1 = -self.rigid.solve(self._sum(self.first, x2))
        return self._sum(self.second, x1, self.third, x2).ravel(), x1, x2

    def _sum(self, *terms) -> np.ndarray:
        """(bodies, m) sum of matrices times vectors (bodies, m), of all ranks."""
        products = [(matrix @ x.ravel()).reshape(len(x), -1)
                    for matrix, x in zip(terms[::2], terms[1::2])]
        return self.team.sum(sum(products[1:], products[0]))[0]
