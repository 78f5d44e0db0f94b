"""Solving with sparse symmetric matrices of which every rank has a part, factorised once: the macro
problem, repositioning.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.linalg import lapack

from orchestrator.method.sparse.symmetric import factorise, regularised, semidefinite_solver
from orchestrator.method.interface.rows import times
from orchestrator.parallel.petsc import SpreadBlocks, shared_by
from orchestrator.parallel.team import Team

COLUMNS = 64  # of A_IS that are eliminated at a time: so many as dense columns are at hand


class SpreadFactor:
    """Solves with a symmetric positive definite matrix of which every rank has a part: each
    eliminates what it alone sees.

    Of A = Σ Aʳ every rank has Aʳ in the unknowns that it sees: I, which no other sees, and S, which
    it shares. With Aʳ = [[A_II, A_IS], [A_SI, A_SS]], A_II complete,

        Σ = Σ_r (A_SS − A_SI A_II⁻¹ A_IS),     Σ x_S = Σ_r (b_S − A_SI A_II⁻¹ b_I),
        x_I = A_II⁻¹ (b_I − A_IS x_S)

    Σ, of the unknowns on the borders between ranks, is a sum of a dense block of each rank: spread
    over the ranks by MUMPS where there is PETSc (``SpreadBlocks``), dense and on every rank where
    there is none, or where it is small (``CommonBlocks``).

    lower : (n, n) sparse, the lower triangle of this rank's part
    number : (n,) int, ascending, which unknowns of all ranks these are
    shared : (n,) bool, those that another rank sees too
    team : the ranks

    Raises RuntimeError: the matrix is singular
    """

    def __init__(self, lower: sp.csr_array, number: np.ndarray, shared: np.ndarray, team: Team):
        self._inside, self._border = np.flatnonzero(~shared), np.flatnonzero(shared)
        whole = lower + sp.tril(lower, -1).T
        self._inner = factorise(whole[self._inside][:, self._inside])
        self._coupling = whole[self._border][:, self._inside]  # A_SI
        left = whole[self._border][:, self._border].toarray()
        for a in range(0, len(left), COLUMNS):
            left[:,
                 a : a + COLUMNS] -= self._coupling @ self._inner(
                     self._coupling[a : a + COLUMNS].toarray()).T
        self._sum = on_borders((left + left.T) / 2, number[shared], team)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """(T, n) solutions in the unknowns that this rank sees, from its part (T, n) of the
        right-hand sides.
        """
        result, own = np.empty_like(rows), rows[:, self._inside]
        found = self._sum(rows[:, self._border] - times(self._coupling, self._inner(own)))
        result[:, self._border] = found
        result[:, self._inside] = self._inner(own - times(self._coupling.T, found))
        return result


def on_borders(block: np.ndarray, number: np.ndarray,
               team: Team) -> Callable[[np.ndarray], np.ndarray]:
    """A solver with the sum of all ranks' blocks: from parts (T, n) of the right-hand sides to
    solutions (T, n).

    block : (n, n) symmetric; number : (n,) int, which unknowns of all ranks these are
    Raises RuntimeError: it is singular
    """
    place, owned = places(number, team)
    total = int(owned.sum())
    petsc = shared_by(team) if total >= team.shared_from else None
    if petsc is not None:
        return SpreadBlocks(petsc, block, place, int(owned[team.rank]), team)
    whole = np.zeros((total, total), order="F")
    whole[np.ix_(place, place)] = block
    triangle = lapack.dtrttf(whole, uplo="L")[0] if total else np.empty(0)
    del whole  # one triangle travels and is kept, not the square
    return CommonBlocks(_factorised(*team.sum(triangle), total), place, total, team)


def semidefinite(part: sp.csr_array, number: np.ndarray,
                 team: Team) -> Callable[[np.ndarray], np.ndarray]:
    """A solver with the sum of all ranks' parts, positive semidefinite, regularised by rounding
    where it is singular: from parts (T, n)
    of the right-hand sides to solutions (T, n). MUMPS's where there is PETSc and many unknowns;
    else every rank has the whole.

    part : (n, n) sparse; number : (n,) int, ascending, which unknowns of all ranks these are
    """
    if team.size == 1:
        return semidefinite_solver(part)
    place, owned = places(number, team)
    total = int(owned.sum())
    if total >= team.shared_from and (petsc := shared_by(team)) is not None:
        try:
            return SpreadBlocks(petsc, regularised(part), place, int(owned[team.rank]), team)
        except RuntimeError:  # on all ranks alike: a pivot vanishes all the same
            pass
    entries = sp.coo_array(part)
    data, row, column = (np.concatenate(same)
                         for same in zip(
                             *team.all_gather((entries.data,
                                               *(place[at] for at in entries.coords)))))
    return CommonBlocks(
        semidefinite_solver(sp.csr_array((data, (row, column)), shape=(total, total))), place,
        total, team)


def places(number: np.ndarray, team: Team) -> tuple[np.ndarray, np.ndarray]:
    """(n,) int, where a rank's numbers are among those of all ranks, rank by rank, and (ranks,) how
    many each is the first to have.
    """
    everyone = team.all_gather(number)
    unique, first = np.unique(np.concatenate(everyone), return_index=True)
    place = np.argsort(np.argsort(first))
    ends = np.cumsum([len(one) for one in everyone])
    return place[np.searchsorted(unique, number)], np.bincount(
        np.searchsorted(ends, first, side="right"), minlength=team.size)


class CommonBlocks:
    """Solves with all of Σ on every rank: one sum per solution, and nobody waits for rank 0. Right
    where borders are small.

    solve : of rows (T, total), with Σ
    place : (n,) int, where this rank's unknowns are among ``total``
    """

    def __init__(self, solve: Callable[[np.ndarray], np.ndarray], place: np.ndarray, total: int,
                 team: Team):
        self._solve, self._place, self._total, self._team = solve, place, total, team

    def __call__(self, parts: np.ndarray) -> np.ndarray:
        """(T, n) solutions at this rank's places, of the sums of all ranks' parts (T, n) of the
        right-hand sides.
        """
        carried = np.zeros((len(parts), self._total))
        carried[:, self._place] = parts
        return self._solve(*self._team.sum(carried))[:, self._place]


def _factorised(triangle: np.ndarray, size: int) -> Callable[[np.ndarray], np.ndarray]:
    """A solver with a dense symmetric matrix (size, size), for rows (T, n); its lower triangle as
    LAPACK packs it (RFP). Raises
    RuntimeError: it is singular"""
    if not size:
        return lambda rows: rows
    factor, failed = lapack.dpftrf(size, triangle, uplo="L")
    if not failed:
        return lambda rows: lapack.dpftrs(size, factor, rows.T, uplo="L")[0].T
    whole = np.tril(lapack.dtfttr(size, triangle, uplo="L")[0])
    # not quite positive definite: on all ranks alike, which hold the same numbers
    lower, pivots = la.lu_factor(whole + np.tril(whole, -1).T)
    if not np.diagonal(lower).all():
        raise RuntimeError("a pivot vanishes")
    return lambda rows: la.lu_solve((lower, pivots), rows.T).T
