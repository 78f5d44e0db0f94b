"""Macro problems: what makes the linear stage global (paper, section 4).

Every rank has the unknowns of the interfaces that it touches, and eliminates those that no other
touches (``SpreadFactor``).

Both strategies end in the same algebra. With G the macro forces on all trace dofs, the linear
stage reads f = s − k w − G α, so that u = u₁ − V α with V = M⁻¹NᵀG, and the multiplier α is set by

- ``equilibrium``:  G = k C,   Cᵀf = 0   ⇒  (CᵀkC − VᵀNᵀG) α = Cᵀf₁   (eq. 17, eq. 31, signs mended)
- ``continuity``:   G = BᵀF,   Gᵀw = 0   ⇒  (GᵀNV) α = Gᵀw₁           (eq. 34, eq. 42)

C = AᵀW repeats the basis of an interface on both its sides; F = (A k Aᵀ) W, eq. 35.

A subdomain answers to the macro forces of its own interfaces alone: NᵀG and V are dense blocks,
rows of its boundary dofs and columns of the macro unknowns that it sees, kept once where subdomains
are alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import Refusal
from orchestrator.method.sparse.symmetric import factorise, Solve
from orchestrator.method.interface.rows import (
    block_diagonal, Blocks, bounds_of, digest, peak, times, unit_rows)
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.spread import SpreadFactor
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.scene.mesh.faces import runs


@dataclass(frozen=True)
class SameShape:
    """Blocks of m subdomains that have the same shape, s macro unknowns and t boundary dofs."""

    members: list[int]  # (m,), places of these subdomains
    sees: np.ndarray  # (m, s) int, macro unknowns of each
    columns: np.ndarray  # (m, t) int, boundary dofs of each
    # (k, s, t) rows of NᵀG and of V; k is m, or 1 where all subdomains share theirs
    forces: np.ndarray
    answers: np.ndarray

    def work(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values, rows and columns of GᵀNV, on and below the diagonal: each (m, s (s + 1) / 2)."""
        each = self.forces @ self.answers.transpose(0, 2, 1)
        each = (each + each.transpose(0, 2, 1)) / 2
        row, column = np.tril_indices(self.sees.shape[1])
        rows, columns = self.sees[:, row], self.sees[:, column]
        return np.broadcast_to(each[:, row, column], rows.shape), rows, columns


def force_blocks(forces: sp.csr_array,
                 parts: Sequence[slice]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Macro unknowns (s,) that each subdomain sees, and its macro forces (s, t): equal ones are the
    same array.

    forces : (B, size) NᵀG
    parts : boundary dofs of each subdomain
    """
    forces.sort_indices()
    ends, place = forces.indptr, np.zeros(forces.shape[1], np.int32)
    sees, blocks, known = [], [], {}
    for part in parts:
        entries = slice(ends[part.start], ends[part.stop])
        column, values, count = forces.indices[entries], forces.data[entries], np.diff(
            ends[part.start : part.stop + 1])
        seen = np.unique(column).astype(np.int32)
        place[seen] = np.arange(len(seen))
        local = place[column]
        key = digest(count, local, values)
        if key not in known:
            block = np.zeros((len(seen), len(count)))
            block[local, np.repeat(np.arange(len(count)), count)] = values
            known[key] = block
        sees.append(seen)
        blocks.append(known[key])
    return sees, blocks


def joined(sees: Sequence[np.ndarray], parts: Sequence[slice], forces: Sequence[np.ndarray],
           answers: Mapping[int, np.ndarray]) -> list[SameShape]:
    """Blocks of all subdomains that have any: where arrays are the same, once; the others by their
    shapes.
    """
    alike: dict[tuple[int, int], list[int]] = {}
    for e, answer in answers.items():
        alike.setdefault((id(forces[e]), id(answer)), []).append(e)
    groups: list[list[int]] = [members for members in alike.values() if len(members) > 1]
    shapes: dict[tuple[int, int], list[int]] = {}
    for members in alike.values():
        if len(members) == 1:
            shapes.setdefault(forces[members[0]].shape, []).extend(members)
    starts, result = np.array([part.start for part in parts], int), []
    for members, shared in [(g, True) for g in groups] + [(g, False) for g in shapes.values()]:
        different = members[:1] if shared else members
        result.append(SameShape(members, np.stack([sees[e] for e in members]),
                                starts[members][:, None] + np.arange(forces[members[0]].shape[1]),
                                np.stack([forces[e] for e in different]),
                                np.stack([answers[e] for e in different])))
    return result


def assembled(blocks: Sequence[SameShape], size: int) -> sp.csr_array:
    """(size, size) the lower triangle of GᵀNV, the sum over all subdomains."""
    parts = [[x.ravel() for x in b.work()] for b in blocks]
    if not parts:
        return sp.csr_array((size, size))
    values, rows, columns = (np.concatenate(same) for same in zip(*parts))
    return sp.csr_array((values, (rows, columns)), shape=(size, size))


class Macro:
    """A macro problem, ready to correct linear stages.

    space : numbering
    direction : search direction k⁻
    bases : per interface (d, m) macro basis
    strategy : "equilibrium" or "continuity"
    spent : back-substitutions per subdomain that the bases have cost

    size : macro unknowns that this rank's subdomains see
    C : (D + G, size) fields, those of ghosts behind
    G : (D, size) macro forces; NᵀG is U of eq. 27
    number : (size,) int, ascending, which of the macro unknowns of all ranks these are; shared :
        (size,) bool, those that another rank sees too
    blocks : V, subdomain by subdomain
    """

    def __init__(self, space: TraceSpace, direction: SearchDirection, bases: list[np.ndarray],
                 strategy: str, spent: float = 0.0):
        self.space, self.strategy, self.spent = space, strategy, spent
        self.number, self.shared = _numbers(space, bases)
        fields, blocks = moved(space, bases), _blocks(space, bases)
        forces = direction.k @ fields[: space.size] if strategy == "equilibrium" else _at_points(
            space, direction, bases)
        self.C, self.size = Blocks.found(fields, blocks), forces.shape[1]
        self.G = Blocks.found(forces,
                              [[(rows, columns) for rows, columns in group
                                if rows.start < space.size] for group in blocks])
        self._worked = fields[: space.size].T @ forces if strategy == "equilibrium" else None
        self._forces = force_blocks(space.scatter @ forces, space.boundary)

    def solve(self, blackbox: BlackBox) -> float:
        """Form V = M⁻¹NᵀG, all subdomains at once, and factorise the macro matrix; it can be asked
        from then on.

        back-substitutions per subdomain (the mean) that it has cost, those of the bases included

        Raises Refusal: the macro matrix is not positive definite: the structure is not held
        Raises BlackBoxError: from the code
        """
        space, (sees, forces), own = self.space, self._forces, self._worked
        del self._forces, self._worked
        answers = blackbox.traces({e: block for e, block in enumerate(forces) if len(block)})
        self.blocks = joined(sees, space.boundary, forces, answers)
        solved, = space.team.sum(sum(map(len, sees)))
        lower = assembled(self.blocks, self.size)
        if own is not None:
            lower = sp.tril((own + own.T) / 2, format="csr") - lower
        self._solve = self._solver(lower)
        return self.spent + float(solved) / space.link.subdomain_count

    def multiplier(self, w: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(T, size) α from the traces (T, D) of the uncorrected stage, eq. 33 (continuity: β,
        eq. 42).
        """
        if self.strategy == "continuity":
            return self._solve(times(self.G.T, w))
        # others' forces are theirs to give
        return self._solve(times(self.C.T, np.pad(f, ((0, 0), (0, self.C.shape[0] - f.shape[1])))))

    def imbalance(self, f: np.ndarray) -> tuple[float, float]:
        """Largest entry of |Cᵀf| in this rank's macro unknowns, and largest sum of its terms'
        magnitudes; f: (T, D + G), the
        neighbours' values behind."""
        found, sizes = times(self.C.T, f), times(self.C.magnitudes().T, np.abs(f))
        return peak(found), peak(sizes)

    def force(self, alpha: np.ndarray) -> np.ndarray:
        """(T, D) G α, the macro forces."""
        return times(self.G, alpha)

    def _solver(self, lower: sp.csr_array) -> Solve | SpreadFactor:
        """Factorise the macro matrix, given the lower triangle of this rank's part, or say what its
        failure means.
        """
        team = self.space.team
        try:
            if lower.diagonal()[~self.shared].min(initial=np.inf) <= 0:
                raise RuntimeError("a diagonal entry is not positive")
            return factorise(lower) if team.size == 1 else SpreadFactor(
                lower, self.number, self.shared, team)
        except RuntimeError as error:
            raise Refusal("singular macro problem", why=error) from error

    def displacement(self, alpha: np.ndarray) -> np.ndarray:
        """(T, B) boundary values of V α = −u₂, eq. 31."""
        return self._summed(alpha, "answers")

    def _summed(self, alpha: np.ndarray, name: str) -> np.ndarray:
        """(T, B) sum of the blocks' forces or answers, times α."""
        result = np.zeros((len(alpha), len(self.space.global_dof)))
        for block in self.blocks:
            result[:, block.columns] = by_blocks(alpha[:, block.sees], getattr(block, name))
        return result


def by_blocks(x: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """(T, m, c) of x (T, m, r) and blocks (m or 1, r, c)."""
    return x @ blocks[0] if len(blocks) == 1 else (x.transpose(1, 0, 2) @ blocks).transpose(1, 0, 2)


def _blocks(space: TraceSpace, bases: Sequence[np.ndarray]) -> list[list[tuple[slice, slice]]]:
    """Trace dofs and macro unknowns of every interface, of their first sides and of their second:
    dofs of a side lie together.
    """
    ends = bounds_of([basis.shape[1] for basis in bases]).tolist()
    return [[(slice(int(at[side][0]), int(at[side][-1]) + 1), slice(a, b))
             for at, a, b in zip(space.sides, ends[:-1], ends[1:])
             if len(at[side]) and b > a] for side in (0, 1)]


def moved(space: TraceSpace, bases: list[np.ndarray]) -> sp.csr_array:
    """(D + G, size) C, fields of all interfaces without a jump: (points, m) each, the same on both
    sides where nodes match, elsewhere
    (trace dofs of side 1 and of side 2, m)."""
    transfer = space.transfer
    dofs = [np.concatenate(sides) for sides in space.sides]
    fields = block_diagonal([np.concatenate([basis, basis]) if match else basis
                             for basis, match in zip(bases, transfer.matched)],
                            [len(at) for at in dofs])
    return sp.csr_array(unit_rows(np.concatenate([np.empty(0, int), *dofs]), transfer.total).T
                        @ fields)


def _at_points(space: TraceSpace, direction: SearchDirection,
               bases: list[np.ndarray]) -> sp.csr_array:
    """(D, size) G = BᵀF, F = A k Aᵀ W forces of the points; k of the first side alone where nodes
    do not match, and W what the
    fields are there."""
    transfer = space.transfer
    first, second = transfer.at_points(direction.whole)
    each = [basis if match else transfer.products.G1[a:b][:, one] @ basis[: len(one)]
            for basis, match, a, b, (one, _) in zip(
        bases, transfer.matched, transfer.bounds[:-1], transfer.bounds[1:], transfer.sides)]
    return sp.csr_array(
        (transfer.B.T @ ((first + second) @ block_diagonal(each, np.diff(transfer.bounds))))[
            : space.size])


def _numbers(space: TraceSpace, bases: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(size,) int, which of the macro unknowns of all ranks this rank's are, and (size,) bool,
    whether another sees them too.
    """
    widths = np.array([basis.shape[1] for basis in bases], int)
    most = np.array(space.team.max(*widths), int)
    shared = [any(len(side) and side[0] >= space.size for side in sides) for sides in space.sides]
    return runs(np.cumsum(most) - most, widths), np.repeat(np.array(shared, bool), widths)
