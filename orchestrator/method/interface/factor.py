"""Solving with sparse symmetric matrices that are factorised once: the macro problem, repositioning, search directions.

Cholesky's factorisation by CHOLMOD in METIS's elimination order: on the macro matrices of cubes three to eight times faster
than SuperLU, with half the numbers. Where it is missing SuperLU takes its place, in the same order if pymetis is there; so it does
for matrices that are not quite positive definite.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.interface import cholmod
from orchestrator.optional import absent, Late
from orchestrator.method.interface.rows import times
from orchestrator.parallel.team import Team

pymetis = Late("pymetis")
# Unknowns from which METIS's order pays with SuperLU: at 2,700 it takes as long as minimum degree, at 24,000 half as long.
ORDERED = 2000
# Largest |A x − b| over that of the diagonal times |x| and b, which a factorisation may leave; sound ones leave some 1e-16, however
# the matrix is conditioned.
BACKWARD = 1e-11

Solve = Callable[[np.ndarray], np.ndarray]  # right-hand sides (n, T) to solutions


class Factor:
    """Solves with a symmetric positive definite sparse matrix, factorised once.

    lower : (n, n) its lower triangle; what is above the diagonal is not looked at
    patches : it has a block for each of many small surfaces: minimum degree finds their order in a tenth of the time
    Raises RuntimeError: it is singular
    """

    def __init__(self, lower: sp.sparray, patches: bool = False):
        lower = sp.tril(lower, format="csc")
        self._solve = np.array if not lower.shape[0] else by_cholesky(lower, "amd" if patches else "metis") or by_superlu(lower)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Solutions (T, n) for rows (T, n) of right-hand sides."""
        return np.ascontiguousarray(self._solve(rows.T).T)


def by_cholesky(lower: sp.csc_array, order: str = "metis") -> Solve | None:
    """CHOLMOD's factorisation in an order by ``metis`` or ``amd``; None where it is not installed, or the matrix is not
    positive definite."""
    factor = cholmod.factorised(lower, order)
    return factor if factor is not None and sound(lower, factor) else None


def by_superlu(lower: sp.csc_array) -> Solve:
    """SuperLU's factorisation, symmetric in its order; ``RuntimeError`` where the matrix is singular."""
    symmetric = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    columns = whole(lower)
    if columns.shape[0] < ORDERED or absent("pymetis"):
        return sla.splu(columns, permc_spec="MMD_AT_PLUS_A", **symmetric).solve
    order = dissection(columns)
    lu = sla.splu(sp.csc_array(columns[order][:, order]), permc_spec="NATURAL", **symmetric)
    back = np.argsort(order)
    return lambda right: lu.solve(right[order])[back]


def whole(lower: sp.csc_array) -> sp.csc_array:
    """A symmetric matrix from its lower triangle."""
    return sp.csc_array(lower + sp.tril(lower, -1).T)


def sound(lower: sp.csc_array, solve: Solve) -> bool:
    """Whether a solver solves one right-hand side: a processor newer than its linear algebra has been seen to get it wrong."""
    diagonal = lower.diagonal()
    right = np.random.default_rng(0).uniform(-1.0, 1.0, len(diagonal))
    found = solve(right)
    left = lower @ found + lower.T @ found - diagonal * found - right
    return bool(np.abs(left).max() <= BACKWARD * (np.abs(diagonal).max() * np.abs(found).max() + 1.0))


def dissection(matrix: sp.sparray) -> np.ndarray:
    """(n,) int, a nested dissection of a symmetric pattern: an elimination order of little fill."""
    pattern = sp.coo_array(matrix)
    row, column = pattern.coords
    off = row != column
    graph = sp.csr_array((np.ones(off.sum(), np.int8), (row[off], column[off])), shape=pattern.shape)
    if not graph.nnz:
        return np.arange(graph.shape[0])
    return np.asarray(pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))[0])


SHIFT = 1e-13  # of the diagonal


def semidefinite_solver(matrix: sp.sparray) -> Callable[[np.ndarray], np.ndarray]:
    """Solver of a positive semidefinite matrix (n, n) for rows (T, n), regularised by rounding where it is singular."""
    matrix = sp.csc_array(matrix)
    if matrix.shape[0] == 0:
        return lambda rows: np.zeros((len(rows), 0))
    scale = matrix.diagonal()
    shifted = sp.tril(matrix + sp.diags_array(np.where(scale > 0, scale, 1.0) * SHIFT), format="csc")
    solve = by_cholesky(shifted) or by_superlu(shifted)
    if not sound(shifted, solve):  # where rounding has made it indefinite, pivots have to be chosen
        solve = sla.splu(whole(shifted)).solve
    return lambda rows: np.ascontiguousarray(solve(rows.T).T)


def is_semidefinite(matrix: sp.sparray, rounding: float) -> bool:
    """Whether a symmetric matrix A (n, n) is positive semidefinite, but for errors of its entries.

    It is, to rounding, if A + rounding × diag A has a factorisation with positive pivots (Sylvester's law of inertia).

    rounding : relative error of the entries, above that of double precision
    """
    scale = matrix.diagonal()
    largest = scale.max(initial=0.0)
    if (scale < -rounding * largest).any():
        return False
    # where nothing is stiff, any entry would be beside the diagonal
    shifted = sp.tril(matrix + sp.diags_array(rounding * np.where(scale > rounding * largest, scale, largest or 1.0)), format="csc")
    if by_cholesky(shifted) is not None:
        return True
    lu = sla.splu(whole(shifted), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return bool(np.array_equal(lu.perm_r, lu.perm_c) and (lu.U.diagonal() > 0).all())


COLUMNS = 64  # of A_IS that are eliminated at a time: so many as dense columns are at hand


class SpreadFactor:
    """Solves with a symmetric positive definite matrix of which every rank has a part: each eliminates what it alone sees.

    Of A = Σ Aʳ every rank has Aʳ in the unknowns that it sees: I, which no other sees, and S, which it shares. With
    Aʳ = [[A_II, A_IS], [A_SI, A_SS]], A_II complete,

        Σ = Σ_r (A_SS − A_SI A_II⁻¹ A_IS),     Σ x_S = Σ_r (b_S − A_SI A_II⁻¹ b_I),     x_I = A_II⁻¹ (b_I − A_IS x_S)

    Σ, of the unknowns on the borders between ranks, is dense and on every rank: one sum per solution, and nobody waits for
    rank 0. That is right as long as borders are small beside the rest: for some dozens of ranks.

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
        whole = np.zeros((self.total, self.total))
        whole[np.ix_(self.border, self.border)] = (left + left.T) / 2
        whole, = self.team.sum(whole)
        if not whole.size:
            return lambda right: right
        try:
            return partial(la.cho_solve, la.cho_factor(whole, lower=True))
        except la.LinAlgError:  # not quite positive definite: on all ranks alike, which hold the same numbers
            lower, pivots = la.lu_factor(whole)
            if not np.diagonal(lower).all():
                raise RuntimeError("a pivot vanishes") from None
            return partial(la.lu_solve, (lower, pivots))

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
