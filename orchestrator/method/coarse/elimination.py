"""Sparse matrices of dense blocks, of bodies and the interfaces between them, eliminated front after front (multifrontal method).

    pattern = BlockPattern(ends, bodies, size)
    pattern.factors(pattern.values(pairs, own), shift).solve(right)

Places and the order of elimination are found once; what remains of an assembly are sums of blocks.

Bodies are ordered by nested dissection (Karypis & Kumar, SIAM J. Sci. Comput. 20, 1998). Bodies that are eliminated
one after the other and see much the same bodies make a *front*, one dense matrix of the bodies that it eliminates and
of those that these see among the ones to come (Duff & Reid, ACM Trans. Math. Softw. 9, 1983):

    F = [[A, B], [C, D]],   G = A⁻¹B,   D − C G goes to the parent front

Order and fronts depend on the places of the blocks alone and are found once. ``fronts`` has the work itself, nearly all of it
dense products. SuperLU takes four to six times as long, in this order as well: matrices of 125 and 343 rigid bodies
2.9 and 30 ms in place of 0.7 and 6.1; the same fronts with numpy 2.6 and 30 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.factor import dissection

OWN_CALLS = 1e5  # operations that BLAS does in the time that one more front takes beside them
PASSED = 50.0  # operations that BLAS does in the time that it takes to pass a number on to the parent
PANEL = 12  # rows of a panel: at fewer products are slower, at more what is not products
BAND = 48  # rows of a band: products of so many columns are nearly as quick as others, and its inverse costs little beside them


class BlockPattern:
    """Where the blocks of bodies and of pairs of bodies go.

    ends : (I, 2) int, the two bodies of every interface
    bodies : number of bodies
    size : rows of a body's block
    order : (I,) int, the interfaces in the order in which they are added up; default: as they are
    """

    def __init__(self, ends: np.ndarray, bodies: int, size: int, order: np.ndarray | None = None):
        self.bodies, self.size, self._factors = bodies, size, None
        rows, columns = np.repeat(ends, 2, axis=1).ravel(), np.tile(ends, 2).ravel()
        own = np.arange(bodies)
        places, where = np.unique(np.concatenate([bodies * rows + columns, bodies * own + own]), return_inverse=True)
        where = where[:len(rows)]
        rows, columns = np.divmod(places, bodies)  # block row after block row
        self.diagonal = np.flatnonzero(columns == rows)
        self.indices, self.indptr = columns.astype(np.int32), np.searchsorted(rows, np.arange(bodies + 1)).astype(np.int32)
        turn = np.arange(len(ends)) if order is None else np.argsort(order)
        sequence = np.lexsort((np.repeat(turn, 4), where))  # the columns of a row stay in this sequence
        starts = np.searchsorted(where[sequence], np.arange(len(places) + 1))
        self.sums = sp.csr_array((np.ones(len(sequence)), sequence, starts), shape=(len(places), len(where)))

    def summed(self, pairs: np.ndarray) -> np.ndarray:
        """(n, size, size) sums of blocks of the interfaces, block row after block row.

        pairs : (I, 2, 2, size, size), first body first
        """
        return (self.sums @ pairs.reshape(-1, self.size**2)).reshape(-1, self.size, self.size)

    def values(self, pairs: np.ndarray, own: np.ndarray) -> np.ndarray:
        """The same with the bodies' own blocks (bodies, size, size)."""
        result = self.summed(pairs)
        result[self.diagonal] += own
        return result

    def matrix(self, values: np.ndarray, shift: float) -> sp.bsr_array:
        """The matrix that ``values`` belong to, with a shift of its diagonal."""
        n = self.size * self.bodies
        return sp.bsr_array((self.shifted(values, shift), self.indices, self.indptr), shape=(n, n))

    def factors(self, values: np.ndarray, shift: float) -> Factors:
        """Of (matrix + shift), in the place of the last ones: fresh memory costs as much as what is done on it."""
        self._factors = self.elimination.factors(self.shifted(values, shift), self._factors)
        return self._factors

    def shifted(self, values: np.ndarray, shift: float) -> np.ndarray:
        """Its blocks with a shift of its diagonal."""
        result = values.copy()
        result[self.diagonal] += (shift * np.eye(self.size)).astype(values.dtype)
        return result

    @cached_property
    def elimination(self) -> Elimination:
        """Order and fronts."""
        return Elimination(self.indptr, self.indices, self.size)


class Elimination:
    """Order and fronts for one pattern.

    indptr, indices : the pattern, block row after block row, symmetric, with the diagonal
    size : rows of a block
    order : (bodies,) int, in which they are eliminated
    fronts : (F, 2) int, how many bodies each eliminates, and how many these see among the ones to come
    layout : where they lie
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray, size: int):
        count, self.size = len(indptr) - 1, size
        pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, indptr), shape=(count, count))
        sees = [indices[a:b][indices[a:b] != i] for i, (a, b) in enumerate(zip(indptr[:-1], indptr[1:]))]
        groups = _grouped(sees, dissection(pattern), size)
        self.order = np.array([body for columns, _, _ in groups for body in columns], dtype=int)
        self.fronts = np.array([(len(columns), len(rest)) for columns, rest, _ in groups], dtype=int).reshape(-1, 2)
        place = np.empty(count, dtype=int)
        place[self.order] = np.arange(count)
        rests = [np.sort(place[np.array(sorted(rest), dtype=int)]) for _, rest, _ in groups]
        entries = place[np.repeat(np.arange(count), np.diff(indptr))], place[indices]
        self.layout = Layout.of(self.fronts, rests, entries, size)
        self._work: np.ndarray | None = None

    def factors(self, blocks: np.ndarray, instead: Factors | None = None) -> Factors:
        """Factorise a matrix.

        blocks : (n, size, size) in the order of the pattern
        instead : earlier factors whose place these may take
        Raises ZeroDivisionError: a pivot vanishes
        """
        from orchestrator.method.coarse.fronts import PRODUCT, eliminate

        (a, m), result = self.layout.sizes.T, instead
        if self._work is None:  # fresh pages cost as much as what is done on them
            self._work = np.empty((m**2).sum())
        if result is None:
            result = Factors(self, np.empty(((a + m) * a).sum()), np.empty((a * m).sum()))
        if eliminate(PRODUCT, blocks, tuple(self.layout), result.own, result.beside, self._work) >= 0:
            raise ZeroDivisionError("a pivot of the coarse contact problem vanishes")
        return result


class Layout(NamedTuple):
    """Fronts as ``fronts`` wants them; bodies are numbered in the order of elimination.

    panel, band : their rows
    sizes : (F, 2) int, rows that are eliminated, rows that are left
    places : (F, 3) int, where a front begins in all L, all U, and all that is left
    starts : (F,) int, the first body of each
    enters : (F + 1,) int, where blocks that enter begin in ``enter`` (k, 3) int: which, and its block row and column
    children : (F + 1,) int, where its children begin in ``child``
    rests : (F + 1,) int, where the bodies that it leaves begin in ``rest``, and in ``within``: their places in its parent
    """

    panel: int
    band: int
    sizes: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    enters: np.ndarray
    enter: np.ndarray
    children: np.ndarray
    child: np.ndarray
    rests: np.ndarray
    rest: np.ndarray
    within: np.ndarray

    @classmethod
    def of(cls, fronts: np.ndarray, rests: Sequence[np.ndarray], entries: tuple[np.ndarray, np.ndarray], size: int) -> Layout:
        """Of fronts (F, 2).

        rests : per front, ascending, the bodies that it leaves
        entries : rows and columns (n,) of the matrix's blocks
        """
        starts, none, panel = _starts(fronts[:, 0]), np.zeros(0, dtype=int), max(1, PANEL // size) * size
        front_of = np.repeat(np.arange(len(fronts)), fronts[:, 0])
        parent = np.array([front_of[rest[0]] if len(rest) else -1 for rest in rests], dtype=int)

        def places(front: int, bodies: np.ndarray) -> np.ndarray:
            """Where some of its bodies are, eliminated ones first."""
            return np.where(bodies < starts[front + 1], bodies - starts[front], fronts[front, 0] + np.searchsorted(rests[front], bodies))

        of = front_of[np.minimum(*entries)]
        blocks, enters = np.argsort(of, kind="stable"), _starts(np.bincount(of, minlength=len(fronts)))
        enter = [np.column_stack([own, *(places(front, x[own]) for x in entries)])
                 for front, own in enumerate(np.split(blocks, enters[1:-1]))]
        child, (a, m) = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0):], size * fronts.T
        return cls(panel, max(1, BAND // panel) * panel, size * fronts,
            np.column_stack([_starts(lengths)[:-1] for lengths in ((a + m) * a, a * m, m**2)]), starts[:-1],
            enters, np.concatenate([np.zeros((0, 3), int), *enter]),
            np.searchsorted(parent[child], np.arange(len(fronts) + 1)), child, _starts(fronts[:, 1]), np.concatenate([none, *rests]),
            np.concatenate([none, *(places(above, rest) for above, rest in zip(parent, rests) if len(rest))]))


@dataclass
class Factors:
    """A factorised matrix.

    of : order and fronts
    own, beside : the numbers, front after front
    """

    of: Elimination
    own: np.ndarray
    beside: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape."""
        from orchestrator.method.coarse.fronts import solve

        result = np.empty(right.shape)
        solve((self.of.order, tuple(self.of.layout), self.own, self.beside), np.ascontiguousarray(right, float), result)
        return result


def _starts(lengths: Sequence[int] | np.ndarray) -> np.ndarray:
    """(n + 1,) where each of some runs starts, and the end."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=int)])


def _grouped(sees: Sequence[np.ndarray], order: np.ndarray, size: int) -> list[tuple[list[int], set[int], list]]:
    """Fronts, children before parents: the bodies eliminated, in order, those that they see, and the children.

    A child is joined with its parent where that costs fewer operations more than a front of its own costs calls.
    """
    count = len(order)
    place = np.empty(count, dtype=int)
    place[order] = np.arange(count)
    children: list[list] = [[] for _ in range(count)]
    roots = []
    for k, body in enumerate(order):
        columns, kept = [int(body)], []
        rest = {int(j) for j in sees[body] if place[j] > k}.union(*(group[1] for group in children[k])) - {int(body)}
        for group in sorted(children[k], key=lambda g: len(g[0])):
            apart = _operations(len(group[0]), len(group[1]), size) + _operations(len(columns), len(rest), size)
            if _operations(len(group[0]) + len(columns), len(rest), size) <= apart + OWN_CALLS + PASSED * (size * len(group[1])) ** 2:
                columns, kept = group[0] + columns, kept + group[2]
            else:
                kept.append(group)
        group = (columns, rest, kept)
        if rest:
            children[min(place[j] for j in rest)].append(group)
        else:
            roots.append(group)
    found, left = [], list(roots)  # parents before children, then turned round
    while left:
        group = left.pop()
        found.append(group)
        left.extend(group[2])
    return found[::-1]


def _operations(own: int, rest: int, size: int) -> float:
    """Of a front that eliminates ``own`` bodies and leaves ``rest``."""
    a, m = own * size, rest * size
    return 2 * a**3 / 3 + 2 * a * a * m + 2 * a * m * m
