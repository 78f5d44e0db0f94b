"""Gaussian elimination of sparse matrices of dense blocks, front after front (multifrontal method).

Bodies are ordered by nested dissection (Karypis & Kumar, SIAM J. Sci. Comput. 20, 1998). Bodies that are eliminated
one after the other and see much the same bodies make a *front*, one dense matrix of the bodies that it eliminates and
of those that these see among the ones to come (Duff & Reid, ACM Trans. Math. Softw. 9, 1983):

    F = [[A, B], [C, D]],   G = A⁻¹B,   D − C G goes to the parent front

Order and fronts depend on the places of the blocks alone and are found once. All work is dense products of LAPACK.
Pivots are sought within A.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dgemm, sgemm
from scipy.linalg.lapack import dgetrf, dgetrs, sgetrf, sgetrs

from orchestrator.method.coarse.kernels import add_blocks, add_matrix
from orchestrator.method.interface.factor import dissection

READ = 20.0  # operations that LAPACK does in single precision in the time that a solution spends on an entry of the factors
OWN_CALLS = 5e5  # operations that LAPACK does in the time that calls for one more front take, some 20 µs


# Factorise, solve, multiply.
ROUTINES = {np.dtype(np.float32): (sgetrf, sgetrs, sgemm), np.dtype(np.float64): (dgetrf, dgetrs, dgemm)}


@dataclass
class Front:
    """One step of the elimination; bodies are numbered in the order of elimination.

    Parameters
    ----------
    start, stop : the bodies it eliminates
    rest : (m,) int, ascending, those to come that these see, at first hand or by elimination
    parent : number of the front that takes what is left, which has the first of ``rest``; −1: none
    within : (m,) int, where ``rest`` are in the parent's bodies, eliminated ones first
    blocks, row, column : which blocks of the matrix enter here, and where, in bodies of this front
    """

    start: int
    stop: int
    rest: np.ndarray
    parent: int = -1
    within: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    blocks: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    row: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    column: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def places(self, bodies: np.ndarray) -> np.ndarray:
        """Where some of its bodies are, eliminated ones first."""
        eliminated = bodies < self.stop
        return np.where(eliminated, bodies - self.start,
                        self.stop - self.start + np.searchsorted(self.rest, bodies))


class Elimination:
    """Order and fronts for one pattern.

    Parameters
    ----------
    indptr, indices : the pattern, block row after block row, symmetric, with the diagonal
    size : rows of a block
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray, size: int):
        count, self.size = len(indptr) - 1, size
        pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, indptr), shape=(count, count))
        sees = [indices[a:b][indices[a:b] != i] for i, (a, b) in enumerate(zip(indptr[:-1], indptr[1:]))]
        groups = _grouped(sees, dissection(pattern), size)
        self.order = np.array([body for columns, _, _ in groups for body in columns], dtype=int)
        place = np.empty(count, dtype=int)
        place[self.order] = np.arange(count)
        self.fronts: list[Front] = []
        front_of = np.repeat(np.arange(len(groups)), [len(columns) for columns, _, _ in groups])
        for columns, rest, _ in groups:
            start = self.fronts[-1].stop if self.fronts else 0
            self.fronts.append(Front(start, start + len(columns), np.sort(place[np.array(sorted(rest), dtype=int)])))
        for front in self.fronts:
            if len(front.rest):
                front.parent = int(front_of[front.rest[0]])
                front.within = self.fronts[front.parent].places(front.rest)
        rows, columns = place[np.repeat(np.arange(count), np.diff(indptr))], place[indices]
        of = front_of[np.minimum(rows, columns)]
        by_front = np.argsort(of, kind="stable")
        ends = np.searchsorted(of[by_front], np.arange(len(groups) + 1))
        for front, a, b in zip(self.fronts, ends[:-1], ends[1:]):
            front.blocks = by_front[a:b]
            front.row, front.column = (front.places(x[front.blocks]) for x in (rows, columns))

    @cached_property
    def worth(self) -> float:
        """How many solutions take as long as the factorisation."""
        sizes = [(front.stop - front.start, len(front.rest)) for front in self.fronts]
        operations = sum(_operations(own, rest, self.size) for own, rest in sizes)
        return operations / (READ * self.size**2 * sum(own * (own + 2 * rest) for own, rest in sizes))

    def factors(self, blocks: np.ndarray) -> Factors:
        """Factorise a matrix.

        Parameters
        ----------
        blocks : (n, size, size) in the order of the pattern, of either precision: that of the factors

        Raises
        ------
        ZeroDivisionError : a pivot vanishes
        """
        size, waiting, done = self.size, [[] for _ in self.fronts], []
        getrf, getrs, gemm = ROUTINES[blocks.dtype]
        for number, front in enumerate(self.fronts):
            own, rest = front.stop - front.start, len(front.rest)
            A, B, C, D = (np.zeros((size * a, size * b), blocks.dtype, order="F") for a in (own, rest) for b in (own, rest))
            add_blocks(blocks, front.blocks, front.row, front.column, own, A, B, C, D)
            for child, left in waiting[number]:
                add_matrix(left, child.within, size, own, A, B, C, D)
            waiting[number] = []
            A, pivots, failed = getrf(A, overwrite_a=True)
            if failed > 0:
                raise ZeroDivisionError("a pivot of the coarse contact problem vanishes")
            if rest:
                B, _ = getrs(A, pivots, B, overwrite_b=True)
                waiting[front.parent].append((front, gemm(-1.0, C, B, beta=1.0, c=D, overwrite_c=True)))
            done.append((A, pivots, C, B))
        return Factors(self, done, getrs)


@dataclass
class Factors:
    """A factorised matrix.

    Parameters
    ----------
    of : order and fronts
    fronts : per front A = P L U, the pivots, C and G = A⁻¹B
    getrs : LAPACK's, of their precision
    """

    of: Elimination
    fronts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
    getrs: Callable

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape."""
        of, x = self.of, right[self.of.order].astype(self.fronts[0][0].dtype)
        for front, (A, pivots, C, _) in zip(of.fronts, self.fronts):
            own = x[front.start:front.stop].reshape(-1)
            own[:] = self.getrs(A, pivots, own)[0]
            if len(front.rest):
                x[front.rest] -= (C @ own).reshape(-1, of.size)
        for front, (_, _, _, G) in zip(reversed(of.fronts), reversed(self.fronts)):
            if len(front.rest):
                own = x[front.start:front.stop].reshape(-1)
                own -= G @ x[front.rest].ravel()
        result = np.empty_like(x)
        result[of.order] = x
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
            if _operations(len(group[0]) + len(columns), len(rest), size) <= apart + OWN_CALLS:
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
