"""Macro problems: what makes the linear stage global (paper, section 4).

Every rank has the unknowns of the interfaces that it touches, and eliminates those that no other touches (``spread``).

Both strategies end in the same algebra. With G the macro forces on all trace dofs, the linear
stage reads f = s − k w − G α, so that u = u₁ − V α with V = M⁻¹NᵀG, and the multiplier α is set by

- ``equilibrium``:  G = k C,   Cᵀf = 0     ⇒  (CᵀkC − VᵀNᵀG) α = Cᵀf₁     (eq. 17, eq. 31, signs mended)
- ``continuity``:   G = BᵀF,   Gᵀw = 0     ⇒  (GᵀNV) α = Gᵀw₁             (eq. 34, eq. 42)

C = AᵀW repeats the basis of an interface on both its sides; F = (A k Aᵀ) W, eq. 35.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.interface.factor import Factor
from orchestrator.method.interface.rows import block_diagonal, fitting, times, unit_rows
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.spread import SpreadFactor
from orchestrator.method.linear.macro_blocks import MacroAnswers
from orchestrator.method.linear.macro_blocks import assembled, force_blocks, joined
from orchestrator.method.refusal import Refusal


class Macro:
    """A macro problem, ready to correct linear stages.

    space : numbering
    direction : search direction k⁻
    bases : per interface (d, m) macro basis
    strategy : "equilibrium" or "continuity"
    spent : back-substitutions per subdomain that the bases have cost

    size : macro unknowns that this rank's subdomains see
    G : (D, size) sparse, macro forces; NᵀG is U of eq. 27
    coupled : how many entries the macro matrix has, this rank's part of it
    number : (size,) int, ascending, which of the macro unknowns of all ranks these are; shared : (size,) bool, those
        that another rank sees too
    blocks : V, subdomain by subdomain
    known : what they tell of the subdomains' own answers, once somebody has asked
    """

    def __init__(self, space: TraceSpace, direction: SearchDirection, bases: list[np.ndarray],
                 strategy: str, spent: float = 0.0):
        self.space, self.strategy, self.spent = space, strategy, spent
        self.known: MacroAnswers | None = None
        self.number, self.shared = _numbers(space, bases)
        C = moved(space, bases)
        if strategy == "equilibrium":
            self.G = fitting(sp.csr_array(direction.k @ C))
        else:
            self.G = _at_points(space, direction, bases)
        self.C = C
        self.size = self.G.shape[1]

        self._forces = force_blocks(sp.csr_array(space.scatter @ self.G), space.boundary)

    def solve(self, blackbox: BlackBox) -> float:
        """Form V = M⁻¹NᵀG, all subdomains at once, and factorise the macro matrix; it can be asked from then on.

        back-substitutions per subdomain (the mean) that it has cost, those of the bases included

        Raises Refusal: the macro matrix is not positive definite: the structure is not held
        Raises BlackBoxError: from the code
        """
        space, (sees, forces) = self.space, self._forces
        del self._forces
        answers = blackbox.traces({e: block for e, block in enumerate(forces) if len(block)})
        self.blocks = joined(sees, space.boundary, forces, answers)
        solved, count = space.team.sum(sum(len(s) for s in sees), len(sees))
        lower = assembled(self.blocks, self.size)
        if self.strategy == "equilibrium":
            own = sp.csr_array(self.C.T @ self.G)
            lower = sp.tril((own + own.T) / 2, format="csr") - lower
        self.coupled = 2 * lower.nnz - self.size
        self._solve = self._solver(lower)
        return self.spent + (float(solved / count) if count else 0.0)

    @cached_property
    def sizes(self) -> sp.csr_array:
        """(D, size) magnitudes of the macro fields C."""
        return sp.csr_array((np.abs(self.C.data), self.C.indices, self.C.indptr), shape=self.C.shape)

    def multiplier(self, w: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(T, size) α from the traces (T, D) of the uncorrected stage, eq. 33 (continuity: β, eq. 42)."""
        return self._solve(times(self.C.T, f) if self.strategy == "equilibrium" else times(self.G.T, w))

    def imbalance(self, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """This rank's part of Cᵀf and of the sum of its terms' magnitudes, to be summed over the ranks: what is shared in
        the unknowns' own places, of the rest the largest in the rank's."""
        team, parts = self.space.team, []
        for values in (times(self.C.T, f), times(self.sizes.T, np.abs(f))):
            if team.size > 1:
                part = np.zeros((len(f), self._solve.total + team.size))
                part[:, self._solve.border] = values[:, self.shared]
                part[:, self._solve.total + team.rank] = np.abs(values[:, ~self.shared]).max(axis=1, initial=0.0)
                values = part
            parts.append(values)
        return parts[0], parts[1]

    def _solver(self, lower: sp.csr_array) -> Factor | SpreadFactor:
        """Factorise the macro matrix, given the lower triangle of this rank's part, or say what its failure means."""
        scale = lower.diagonal()
        try:
            if lower.shape[0] and scale[~self.shared].min(initial=np.inf) <= 0:
                raise RuntimeError("a diagonal entry is not positive")
            team = self.space.team
            return Factor(lower) if team.size == 1 else SpreadFactor(lower, self.number, self.shared, team)
        except RuntimeError as error:
            raise Refusal("singular macro problem", why=error) from error

    def displacement(self, alpha: np.ndarray) -> np.ndarray:
        """(T, B) boundary values of V α = −u₂, eq. 31."""
        result = np.zeros((len(alpha), len(self.space.global_dof)))
        for block in self.blocks:
            block.displace(alpha, result)
        return result


def moved(space: TraceSpace, bases: list[np.ndarray]) -> sp.csr_array:
    """(D, size) C, fields of all interfaces without a jump: (points, m) each, the same on both sides where nodes match, elsewhere
    (trace dofs of side 1 and of side 2, m)."""
    transfer = space.transfer
    dofs = [np.concatenate(sides) for sides in space.sides]
    fields = block_diagonal([np.concatenate([basis, basis]) if match else basis for basis, match in zip(bases, transfer.matched)],
                            [len(at) for at in dofs])
    both = sp.csr_array((unit_rows(np.concatenate([np.empty(0, int), *dofs]), transfer.total).T @ fields)[: space.size])
    if space.ties is None:
        return both
    both = sp.csr_array(space.ties.change @ both)
    if not transfer.picks:  # points follow the other side, mid-edge nodes their corners
        loose = np.ones(space.size)
        loose[space.ties.dofs] = 0.0
        both = sp.csr_array(sp.diags_array(loose) @ both)
    return both


def _at_points(space: TraceSpace, direction: SearchDirection, bases: list[np.ndarray]) -> sp.csr_array:
    """(D, size) G = BᵀF, F = A k Aᵀ W forces of the points; k of the first side alone where nodes do not match, and W what the
    fields are there."""
    transfer = space.transfer
    first, second = transfer.at_points(direction.whole)
    each = [basis if match else transfer.products.G1[a:b][:, one] @ basis[: len(one)] for basis, match, a, b, (one, _) in zip(
        bases, transfer.matched, transfer.bounds[:-1], transfer.bounds[1:], transfer.sides)]
    return pushing(space, each, first + second)


def pushing(space: TraceSpace, bases: list[np.ndarray], k: sp.csr_array | None = None) -> sp.csr_array:
    """(D, size) forces Bᵀ k W of the points' fields W, (points, m) of every interface, on both sides; k: 1 unless given."""
    transfer = space.transfer
    fields = block_diagonal(bases, np.diff(transfer.bounds))
    both = sp.csr_array(transfer.B[:, : space.size].T @ (fields if k is None else k @ fields))
    return both if space.ties is None else sp.csr_array(space.ties.change @ both)


def _numbers(space: TraceSpace, bases: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(size,) int, which of the macro unknowns of all ranks this rank's are, and (size,) bool, whether another sees them too."""
    widths = np.array([basis.shape[1] for basis in bases], dtype=int)
    most = np.array(space.team.max(*widths), dtype=int)
    starts = np.cumsum(most) - most
    shared = [any(len(side) and side[0] >= space.size for side in sides) for sides in space.sides]
    within = np.arange(widths.sum()) - np.repeat(np.cumsum(widths) - widths, widths)
    return np.repeat(starts, widths) + within, np.repeat(np.array(shared, dtype=bool), widths)
