"""Linear systems with matrices that change little from one to the next.

A factorisation of an earlier matrix preconditions GMRES (Saad & Schultz, SIAM J. Sci. Stat. Comput. 7, 1986) for the
next ones. Where it does not serve, the matrix is factorised anew.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.coarse.block_pattern import BlockPattern
from orchestrator.method.coarse.elimination import Factors

ACCURACY = 1e-3  # relative residual: less costs Newton steps, and iterations where bodies are loose
MOST = 12  # GMRES steps, which cost about as much as half a factorisation


class StaleFactors:
    """Solver for matrices of one pattern.

    Parameters
    ----------
    pattern : where their blocks are

    Attributes
    ----------
    factorised : key → values and shift of the matrix whose factors are kept
    renewed : keys of those that are new since ``renewed`` was cleared
    """

    def __init__(self, pattern: BlockPattern):
        self.pattern = pattern
        self.factors: dict[Hashable, Factors] = {}
        self.factorised: dict[Hashable, tuple[np.ndarray, float]] = {}
        self.renewed: set[Hashable] = set()

    def solve(self, key: Hashable, values: np.ndarray, right: np.ndarray, shift: float) -> np.ndarray:
        """(bodies, size) solution of (matrix + shift) x = right.

        Parameters
        ----------
        key : of the matrices that are alike
        """
        matrix, right, factor = self.pattern.matrix(values, shift), right.ravel(), self.factors.get(key)
        if factor is not None:
            after = sla.LinearOperator(matrix.shape, lambda z: matrix @ factor.solve(z), dtype=float)
            z, missed = sla.gmres(after, right, rtol=ACCURACY, atol=0.0, restart=MOST, maxiter=1)
            if not missed:
                return factor.solve(z).reshape(self.pattern.bodies, -1)
        return self._keep(key, values, shift, matrix).solve(right).reshape(self.pattern.bodies, -1)

    def _keep(self, key: Hashable, values: np.ndarray, shift: float, matrix: sp.bsr_array) -> Factors:
        self.factorised[key] = values, shift
        self.renewed.add(key)
        factor = self.factors[key] = self.pattern.factorise(matrix)
        return factor

    def recall(self, factorised: Mapping[Hashable, tuple[np.ndarray, float]]) -> None:
        """Factorise again what was ``factorised``: the next solutions are then the same to the last bit."""
        for key, (values, shift) in factorised.items():
            self._keep(key, values, shift, self.pattern.matrix(values, shift))
