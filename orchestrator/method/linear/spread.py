"""A symmetric positive definite matrix among ranks: each eliminates the unknowns that it alone sees.

Every rank has a part Aʳ of A = Σ Aʳ in the unknowns that it sees: I, which no other sees, and S, which it shares. With
Aʳ = [[A_II, A_IS], [A_SI, A_SS]], A_II complete,

    Σ = Σ_r (A_SS − A_SI A_II⁻¹ A_IS),     Σ x_S = Σ_r (b_S − A_SI A_II⁻¹ b_I),     x_I = A_II⁻¹ (b_I − A_IS x_S)

Σ, of the unknowns on the borders between ranks, is dense and on every rank: one sum per solution, and nobody waits for
rank 0. That is right as long as borders are small beside the rest: for some dozens of ranks. It is kept in LAPACK's
rectangular format (Gustavson et al., ACM Trans. Math. Softw. 37, 2010): one triangle, in n (n + 1) / 2 numbers that
are summed over the ranks as they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.linalg.lapack import dpftrf, dpftrs

from orchestrator.method.interface.factor import Factor
from orchestrator.method.interface.rows import times
from orchestrator.parallel.team import Team

COLUMNS = 64  # of A_IS that are eliminated at a time: so many as dense columns are at hand


class SpreadFactor:
    """Solves with a matrix of which every rank has a part.

    lower : (n, n) sparse, the lower triangle of this rank's part
    number : (n,) int, ascending, which unknowns of all ranks these are
    shared : (n,) bool, those that another rank sees too
    team : the ranks

    border : (n_S,) int, where this rank's shared unknowns are among those of all ranks; total : how many these are
    Raises RuntimeError: the matrix is singular
    """

    def __init__(self, lower: sp.csr_array, number: np.ndarray, shared: np.ndarray, team: Team):
        self.team, self.inner, self.outer = team, np.flatnonzero(~shared), np.flatnonzero(shared)
        everyone = np.unique(np.concatenate(team.all_gather(number[self.outer])))
        self.border, self.total = np.searchsorted(everyone, number[self.outer]), len(everyone)
        whole = sp.csr_array(lower + sp.tril(lower, -1).T)
        self._inner = Factor(sp.csr_array(sp.tril(whole[self.inner][:, self.inner])))
        self._coupling = sp.csr_array(whole[self.outer][:, self.inner])
        self._back = sp.csr_array(self._coupling.T)
        left = whole[self.outer][:, self.outer].toarray()
        for a in range(0, len(self.outer), COLUMNS):
            left[:, a : a + COLUMNS] -= self._coupling @ self._inner(self._coupling[a : a + COLUMNS].toarray()).T
        self._border = self._factorised(left)

    def _factorised(self, left: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """What solves with Σ, to which this rank adds (n_S, n_S), symmetric but for rounding: columns (n, T) to columns."""
        n = self.total
        if not n:
            return lambda right: right
        packed = np.zeros(n * (n + 1) // 2)
        for i, at in enumerate(self.border):  # a row at a time: indices of all entries would take more room than they do
            packed[rectangular(n, at, self.border[: i + 1])] = (left[i, : i + 1] + left[: i + 1, i]) / 2
        factor, failed = dpftrf(n, self.team.sum(packed)[0], uplo="L", overwrite_a=True)
        if not failed:
            return lambda right: dpftrs(n, factor, right, uplo="L")[0]
        # not quite positive definite: on all ranks alike, which hold the same numbers
        whole, lower = np.zeros((n, n)), (left + left.T) / 2
        whole[np.ix_(self.border, self.border)] = np.tril(lower)
        whole, = self.team.sum(whole)
        lower, pivots = la.lu_factor(whole + np.tril(whole, -1).T, overwrite_a=True)
        if not np.diagonal(lower).all():
            raise RuntimeError("a pivot vanishes")
        return lambda right: la.lu_solve((lower, pivots), right)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """(T, n) solutions in the unknowns that this rank sees, from its part (T, n) of the right-hand sides."""
        result, right = np.empty_like(rows), rows[:, self.inner]
        carried = np.zeros((len(rows), self.total))
        carried[:, self.border] = rows[:, self.outer] - times(self._coupling, self._inner(right))
        carried, = self.team.sum(carried)
        found = self._border(carried.T).T[:, self.border]
        result[:, self.outer] = found
        result[:, self.inner] = self._inner(right - times(self._back, found))
        return result


def rectangular(n: int, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Where the entries (row ≥ column) of a lower triangle of order n are in LAPACK's rectangular full packed format."""
    half, odd = (n + 1) // 2, n % 2
    height = n if odd else n + 1
    first = column < half  # the others are of the second triangle, which is transposed above the first one
    return np.where(first, column * height + row + (1 - odd), (row - half + odd) * height + column - half)
