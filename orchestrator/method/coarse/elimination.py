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

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import cores, in_parts
from orchestrator.method.coarse.layout import Layout
from orchestrator.method.coarse.subtrees import side_by_side
from orchestrator.method.interface.factor import dissection

OWN_CALLS = 1e5  # operations that BLAS does in the time that one more front takes beside them
PASSED = 50.0  # operations that BLAS does in the time that it takes to pass a number on to the parent


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
        self._apart = side_by_side(self.layout.parent, np.array([_operations(*front, size) for front in self.fronts]), cores())
        self._work: np.ndarray | None = None

    def factors(self, blocks: np.ndarray, instead: Factors | None = None) -> Factors:
        """Factorise a matrix.

        blocks : (n, size, size) in the order of the pattern
        instead : earlier factors whose place these may take
        Raises ZeroDivisionError: a pivot vanishes
        """
        from orchestrator.method.coarse.fronts import PRODUCT, eliminate

        order, bounds = self._apart
        (a, m), result = self.layout.sizes.T, instead
        if self._work is None:  # fresh pages cost as much as what is done on them
            self._work = np.empty((m**2).sum())
        if result is None:
            result = Factors(self, np.empty(((a + m) * a).sum()), np.empty((a * m).sum()))
        given = PRODUCT, blocks, tuple(self.layout), result.own, result.beside, self._work, order, bounds
        sound = in_parts(eliminate, len(bounds) - 2, *given, part=1) if len(bounds) > 2 else []
        if not all(sound) or not eliminate(len(bounds) - 2, len(bounds) - 1, *given):
            raise ZeroDivisionError("a pivot of the coarse contact problem vanishes")
        return result


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
