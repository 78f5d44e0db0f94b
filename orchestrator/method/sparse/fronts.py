"""Sparse matrices of dense blocks, eliminated front after front (multifrontal method).

Bodies are ordered by nested dissection (Karypis & Kumar, SIAM J. Sci. Comput. 20, 1998). Bodies
that are eliminated one after the other and see much the same bodies make a *front*, one dense
matrix of the bodies that it eliminates and of those that these see among the ones to come (Duff &
Reid, ACM Trans. Math. Softw. 9, 1983):

    F = [[A, B], [C, D]],   G = A⁻¹B,   D − C G goes to the parent front

Order and fronts depend on the places of the blocks alone and are found once. SuperLU takes two to
three times as long, in this order as well: blocks of twelve rows of 125, 343 and 1,000 bodies 18,
140 and 1,200 ms in place of 8, 50 and 360.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dgetrf, dgetrs

from orchestrator.compiled import compiled
from orchestrator.linalg import dissection
from orchestrator.method.interface.rows import bounds_of

OWN_CALLS = 5e5  # operations that BLAS does in the time that one more front takes beside them
# operations that BLAS does in the time that it takes to pass a number on to the parent
PASSED = 50.0
# operations of an elimination, from which GMRES beside a smaller one is quicker: of some 200 bodies
WORTH = 3e8


@dataclass(frozen=True)
class Front:
    """A dense matrix of some bodies.

    own : how many of them it eliminates, the first
    bodies : (n,) int, which they are, by their place in the order of elimination
    entering : (k, 3) int, blocks of the matrix that enter it, and their block row and column
    children : fronts that pass on to it, and the places (m,) int of their bodies among its own
    """

    own: int
    bodies: np.ndarray
    entering: np.ndarray
    children: list[tuple[int, np.ndarray]]


class Elimination:
    """Order and fronts for one pattern.

    indptr, indices : the pattern, block row after block row, symmetric, with the diagonal
    size : rows of a block; those that are eliminated, which are the first ``rigid`` alone where
        that saves much
    order : (bodies,) int, in which they are eliminated
    fronts : children before parents
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray, size: int, rigid: int = 0):
        count, self.indptr, self.indices = len(indptr) - 1, indptr, indices
        pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, indptr),
                               shape=(count, count))
        sees, order = [indices[a:b][indices[a:b] != i] for i, (a, b) in enumerate(
            zip(indptr[:-1], indptr[1:]))], dissection(pattern)
        groups = grouped(sees, order, size)
        if rigid and sum(operations(len(columns), len(rest), size)
                         for columns, rest, _ in groups) >= WORTH:
            groups, size = grouped(sees, order, rigid), rigid
        self.size = size
        self.order = np.array([body for columns, _, _ in groups for body in columns], dtype=int)
        place, owns = np.argsort(self.order), [len(columns) for columns, _, _ in groups]
        starts, front_of = bounds_of(owns), np.repeat(np.arange(len(groups)), owns)
        row, column = place[np.repeat(np.arange(count), np.diff(indptr))], place[indices]
        of = front_of[np.minimum(row, column)]
        blocks = np.split(np.argsort(of, kind="stable"),
                          np.cumsum(np.bincount(of, minlength=len(groups)))[:-1])
        self.fronts: list[Front] = []
        for f, (_, rest, _) in enumerate(groups):
            rest = np.sort(place[np.array(sorted(rest), dtype=int)])
            bodies = np.concatenate([np.arange(starts[f], starts[f + 1]), rest])
            entering = np.column_stack([blocks[f], *(np.searchsorted(bodies, x[blocks[f]])
                                                     for x in (row, column))])
            self.fronts.append(Front(owns[f], bodies, entering, []))
        for f, front in enumerate(self.fronts):
            if len(rest := front.bodies[front.own:]):
                parent = self.fronts[front_of[rest[0]]]
                parent.children.append((f, np.searchsorted(parent.bodies, rest)))

    def factors(self, blocks: np.ndarray, shift: float) -> Factors:
        """Factorise a matrix.

        blocks : (k, size, size), in the order of the pattern
        shift : of its diagonal
        Raises ZeroDivisionError: a pivot vanishes
        """
        size, left, parts = self.size, {}, []
        for f, front in enumerate(self.fronts):
            n, a = len(front.bodies), size * front.own
            F = np.zeros((size * n, size * n))
            which, row, column = front.entering.T
            F.reshape(n, size, n, size)[row, :, column] = blocks[which]
            F.reshape(-1)[: a * (size * n + 1) : size * n + 1] += shift
            for child, places in front.children:
                added(left.pop(child), places, size, F)
            lu, pivots, failed = dgetrf(F[:a, :a])
            if failed:
                raise ZeroDivisionError("a pivot of the coarse contact problem vanishes")
            across = dgetrs(lu, pivots, F[:a, a:])[0] if n > front.own else F[:a, a:]
            left[f] = F[a:, a:] - F[a:, :a] @ across
            parts.append((lu, pivots, F[a:, :a].copy(), across))
        return Factors(self, parts)


@dataclass
class Factors:
    """A factorised matrix.

    of : order and fronts
    parts : LU and pivots of A, C and G of each front
    """

    of: Elimination
    parts: list[tuple[np.ndarray, ...]]

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape."""
        x, fronts = right[self.of.order], self.of.fronts
        for front, (lu, pivots, below, _) in zip(fronts, self.parts):
            own, rest = front.bodies[: front.own], front.bodies[front.own:]
            found = dgetrs(lu, pivots, x[own].ravel())[0]
            x[own] = found.reshape(-1, right.shape[1])
            x[rest] -= (below @ found).reshape(-1, right.shape[1])
        for front, (_, _, _, across) in zip(reversed(fronts), reversed(self.parts)):
            own, rest = front.bodies[: front.own], front.bodies[front.own:]
            x[own] -= (across @ x[rest].ravel()).reshape(-1, right.shape[1])
        result = np.empty_like(x)
        result[self.of.order] = x
        return result


@compiled
def added(given, places, size, F):
    """F += blocks of ``size`` rows (m, m) of what a child leaves, at places (m,) int."""
    for u in range(len(places)):
        for r in range(size):
            row, of = F[size * places[u] + r], given[size * u + r]
            for v in range(len(places)):
                for c in range(size):
                    row[size * places[v] + c] += of[size * v + c]


def grouped(sees: Sequence[np.ndarray], order: np.ndarray,
            size: int) -> list[tuple[list[int], set[int], list]]:
    """Fronts, children before parents: the bodies eliminated, in order, those that they see, and
    the children.

    A child is joined with its parent where that costs fewer operations more than a front of its own
    costs calls.
    """
    place, children = np.argsort(order), [[] for _ in order]
    roots = []
    for k, body in enumerate(order):
        columns, kept = [int(body)], []
        rest = {int(j) for j in sees[body] if place[j] > k}.union(
            *(group[1] for group in children[k])) - {int(body)}
        for group in sorted(children[k], key=lambda g: len(g[0])):
            apart = operations(len(group[0]), len(group[1]),
                               size) + operations(len(columns), len(rest), size)
            if operations(len(group[0]) + len(columns), len(rest),
                          size) <= apart + OWN_CALLS + PASSED * (size * len(group[1])) ** 2:
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


def operations(own: int, rest: int, size: int) -> float:
    """Of a front that eliminates ``own`` bodies and leaves ``rest``."""
    a, m = own * size, rest * size
    return 2 * a**3 / 3 + 2 * a * a * m + 2 * a * m * m
