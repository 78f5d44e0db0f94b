"""Newton's matrices of many bodies in affine fields: rigid motions eliminated, stretches solved body by body, both joined by GMRES.

Bodies resist being stretched far more than their neighbours let them feel, so that the rigid motions, the first half of a body's fields,
carry nearly all that goes from body to body. With P these, B the blocks of all bodies' stretches, and A₁₁ = PᵀA P,

    M r = s + P A₁₁⁻¹ Pᵀ(r − A s),     s = B⁻¹ r

leaves nothing of r in rigid motions, Pᵀ A M r = Pᵀ r: what follows M r therefore changes only what is left in stretches, and loose
bodies, whose stiffness is a millionth of others', are solved for exactly at once. GMRES (Saad & Schultz, SIAM J. Sci. Stat. Comput. 7, 1986) needs
four to seven steps to 1e-3 in matrices of 125 grains. Half of the rows in the fronts are an eighth of the operations.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.coarse.elimination import Factors
from orchestrator.parallel.team import Team

ENOUGH = 1e-3  # ‖r‖ left, over that of the right-hand side: a tenth of what a coarse solve is asked for
MOST = 40  # steps, after which what has been found is taken: it is searched along as any step is


class RigidFirst:
    """A matrix that can be solved with.

    rigid : factors of the first rows of all blocks
    matrix : the part of it that this rank has
    own : (bodies, m, m) of the last rows of its diagonal blocks
    """

    def __init__(self, rigid: Factors, matrix: sp.bsr_array, own: np.ndarray, team: Team):
        self.rigid, self.matrix, self.team, self.first = rigid, matrix, team, rigid.of.size
        self.stretch = np.linalg.inv(team.sum(own)[0])

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape, which all ranks have; on all ranks."""
        x = self._near(right)
        left = right - self._times(x)
        goal, size = ENOUGH * np.linalg.norm(right), np.linalg.norm(left)
        if size <= goal:
            return x
        basis, found, H = [left / size], [], np.zeros((MOST + 1, MOST))
        for k in range(MOST):
            found.append(self._near(basis[k]))
            new = self._times(found[k])
            for _ in range(2):  # once more for what rounding has left
                part = np.array([np.vdot(v, new) for v in basis])
                H[: k + 1, k] += part
                new = new - np.tensordot(part, basis, 1)
            H[k + 1, k] = np.linalg.norm(new)
            start = size * np.eye(k + 2, 1)[:, 0]
            y = np.linalg.lstsq(H[: k + 2, : k + 1], start)[0]
            if np.linalg.norm(start - H[: k + 2, : k + 1] @ y) <= goal or not H[k + 1, k] > 0:
                break
            basis.append(new / H[k + 1, k])
        return x + np.tensordot(y, found, 1)

    def _near(self, right: np.ndarray) -> np.ndarray:
        """M r."""
        first = self.first
        x = np.zeros(right.shape)
        x[:, first:] = np.einsum("bij,bj->bi", self.stretch, right[:, first:])
        x[:, :first] = self.rigid.solve((right - self._times(x))[:, :first])
        return x

    def _times(self, x: np.ndarray) -> np.ndarray:
        return self.team.sum((self.matrix @ x.ravel()).reshape(x.shape))[0]
