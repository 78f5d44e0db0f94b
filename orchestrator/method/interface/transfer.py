"""How the two sides of an interface meet: jumps at points, forces of the points on either side (paper, eq. 5).

Whatever crosses an interface goes through a transfer. With the traces w of all sides in one vector and Q points,

    first(w) = G₁ w,    second(w) = G₂ w,    jump(w) = G₂ w − G₁ w = B w,    spread(q₁, q₂) = G₁ᵀ q₁ + G₂ᵀ q₂

so that a force q on the first side and −q on the second, ``spread(q, −q)``, works in the jump alone, and forces
(f₁, f₂) are in balance where first(f) + second(f) = A f vanishes. Where the meshes of both sides match, the points
are their common nodes and G₁, G₂ pick entries: ``Matching`` holds index arrays, and no product is formed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import narrow


@dataclass(frozen=True)
class Matching:
    """Transfer between sides whose nodes match: a permutation.

    Parameters
    ----------
    one, two : int arrays of any shape, here called Q: the trace dof of each point on side 1 and on side 2, below
        D + G; anything where the point has none
    size, total : number of trace dofs D, and with ghosts D + G
    bounds : (interfaces + 1,) int, where the points of each interface of the scene start, along the last axis
    exists : bool, same shape; False where a component is prescribed and nothing crosses. None: all are there
    """

    one: np.ndarray
    two: np.ndarray
    size: int
    total: int
    bounds: np.ndarray
    exists: np.ndarray | None = None

    @classmethod
    def of(cls, sides: Sequence[tuple[np.ndarray, np.ndarray]], size: int) -> Matching:
        """Of interfaces, for each the trace dofs of side 1 and of side 2 in the order of their common nodes."""
        none = [np.empty(0, int)]
        one, two = (np.concatenate(none + [pair[side] for pair in sides]) for side in (0, 1))
        return cls(one, two, size, size, np.cumsum([0] + [len(a) for a, _ in sides]))

    # ---- fields --------------------------------------------------------------------------------

    def first(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) of traces (…, D + G), on side 1; zero where there is none."""
        return self._there(x.take(self.one, axis=-1))

    def second(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) of traces (…, D + G), on side 2; zero where there is none."""
        return self._there(x.take(self.two, axis=-1))

    def jump(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) second(x) − first(x)."""
        return self.second(x) - self.first(x)

    def spread(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """(…, D + G) of values (…, Q) on side 1 and on side 2; zero on traces of other interfaces."""
        rows = one.shape[: one.ndim - self.one.ndim]
        result = np.zeros((*rows, self.total))
        for at, values in ((self.one, one), (self.two, two)):
            if self._whole:
                result[..., at] = values
            else:
                result[..., at[self.exists]] = values[..., self.exists]
        return result

    def across(self, x: np.ndarray) -> np.ndarray:
        """(…, D) of traces (…, D + G): at every trace dof what the other side has there."""
        return x.take(self.partner, axis=-1)

    def mismatch(self, w: np.ndarray) -> np.ndarray:
        """(…, D) what the sides of traces (…, D + G) are apart, at both nodes of a pair."""
        return self.across(w) - w[..., : self.size]

    def imbalance(self, f: np.ndarray) -> np.ndarray:
        """(…, D) what the sides' forces (…, D + G) do not cancel, at both nodes of a pair."""
        return f[..., : self.size] + self.across(f)

    def opposed_traces(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A place (D,) for every trace dof, and two arrays that have there what the other side's w and f are, so that
        ``mismatch`` and ``imbalance`` of traces (…, D + G) need not be formed."""
        return self.partner, w, f

    # ---- matrices ------------------------------------------------------------------------------

    def seen_across(self, matrix: sp.csr_array) -> sp.csr_array:
        """(D, D) a matrix (D + G, D + G) of all sides, as the other sides see it."""
        return sp.csr_array(matrix[self.partner][:, self.partner])

    def rows(self, fields: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """Q × m of sparse columns (D + G, m), on side 1 and on side 2."""
        return fields[self.one], fields[self.two]

    def at_points(self, matrix: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """Q × Q matrices of side 1 and of side 2, of a matrix (D + G, D + G) that couples no two sides."""
        return tuple(sp.csr_array(matrix[side][:, side]) for side in (self.one, self.two))

    def node_blocks(self, matrix: sp.csr_array) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3, 3) diagonal blocks of a matrix at points (3, P), on side 1 and on side 2; zero where prescribed."""
        found = []
        for dofs in (self.one.T, self.two.T):
            rows = np.repeat(dofs[:, :, None], 3, axis=2)
            columns = np.repeat(dofs[:, None, :], 3, axis=1)
            values = np.asarray(matrix[rows.ravel(), columns.ravel()]).reshape(-1, 3, 3)
            there = np.ones((len(dofs), 3), bool) if self._whole else self.exists.T
            found.append(np.where(there[:, :, None] & there[:, None, :], values, 0.0))
        return tuple(found)

    def both_sides(self, bases: Sequence[np.ndarray], signs: tuple[float, float]) -> sp.csr_array:
        """(D, sum of m) fields of every interface, (points, m) each, on both its sides with a sign for each.

        Interfaces without points here keep their columns. Zeros are no entries.
        """
        widths, counts = np.array([b.shape[1] for b in bases], dtype=int), np.diff(self.bounds)
        values = np.concatenate([np.empty(0), *(b.ravel() for b, count in zip(bases, counts) if count)])  # what is met here
        width = np.repeat(widths, counts)  # of each point's row of its basis
        filled, point = np.flatnonzero(values), np.repeat(np.arange(len(width)), width)
        point = point[filled]
        column = filled + (np.repeat(np.cumsum(widths) - widths, counts) - (np.cumsum(width) - width))[point]
        ends = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=len(width) + 1))])  # the last row is empty
        on_points = narrow(sp.csr_array((values[filled], column, ends), shape=(len(width) + 1, int(widths.sum()))))
        at, sign_of = np.full(self.size, len(width)), np.zeros(self.size)  # of each trace dof: it has one point at most
        for side, sign in zip((self.one, self.two), signs):
            mine = np.flatnonzero(side < self.size)
            at[side[mine]], sign_of[side[mine]] = mine, sign
        both = narrow(sp.csr_array(on_points[at]))
        if signs[0] != 1 or signs[1] != 1:
            both.data *= np.repeat(sign_of, np.diff(both.indptr))
        return both

    def displacements(self, bases: Sequence[np.ndarray]) -> sp.csr_array:
        """(D, sum of m) fields of every interface without any jump: (points, m) each, the same on both its sides."""
        return self.both_sides(bases, (1.0, 1.0))

    # ---- parts ---------------------------------------------------------------------------------

    def stiffnesses(self, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q,) what a diagonal stiffness (D + G,) is at the points, on side 1 and on side 2."""
        return self.first(diagonal), self.second(diagonal)

    @property
    def matching(self) -> Matching:
        """The interfaces whose nodes match: all of them."""
        return self

    def opposite(self, dofs: np.ndarray) -> np.ndarray:
        """Trace dofs, ascending, that meet some of the given ones."""
        chosen = np.zeros(self.total, bool)
        chosen[dofs] = True
        return np.unique(np.concatenate([self.two[chosen[self.one]], self.one[chosen[self.two]]]))

    def renumbered(self, place: np.ndarray, size: int, total: int) -> Matching:
        """The points that have both sides in another numbering.

        Parameters
        ----------
        place : (D + G,) int, new number of each trace dof, −1 for those that are left out
        """
        one, two = place[self.one], place[self.two]
        kept = (one >= 0) & (two >= 0)
        bounds = np.concatenate([[0], np.cumsum(kept)])[self.bounds]
        return Matching(one[kept], two[kept], size, total, bounds)

    def some(self, chosen: np.ndarray) -> Matching:
        """Some of the points along the last axis, ascending."""
        return replace(self, one=self.one[..., chosen], two=self.two[..., chosen],
                       bounds=np.searchsorted(chosen, self.bounds),
                       exists=None if self.exists is None else self.exists[..., chosen])

    def matches(self, index: int) -> bool:
        """Whether the nodes of an interface of the scene match."""
        return True

    @cached_property
    def dofs(self) -> np.ndarray:
        """Trace dofs of all points that exist, those of side 1 first."""
        return np.concatenate([side.ravel() if self._whole else side[self.exists] for side in (self.one, self.two)])

    @cached_property
    def mine(self) -> np.ndarray:
        """(Q,) bool, points whose first side is on this rank: it adds up what belongs to them."""
        return self.one < self.size

    @cached_property
    def partner(self) -> np.ndarray:
        """(D,) int, the trace dof that each one meets."""
        result = np.empty(self.total, dtype=int)
        result[self.one], result[self.two] = self.two, self.one
        return result[: self.size]

    @cached_property
    def _whole(self) -> bool:
        return self.exists is None or bool(self.exists.all())

    def _there(self, x: np.ndarray) -> np.ndarray:
        return x if self._whole else np.where(self.exists, x, 0.0)
