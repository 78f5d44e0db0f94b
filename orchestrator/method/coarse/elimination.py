"""Gaussian elimination of sparse matrices of dense blocks, front after front (multifrontal method).

Bodies are ordered by nested dissection (Karypis & Kumar, SIAM J. Sci. Comput. 20, 1998). Bodies that are eliminated
one after the other and see much the same bodies make a *front*, one dense matrix of the bodies that it eliminates and
of those that these see among the ones to come (Duff & Reid, ACM Trans. Math. Softw. 9, 1983):

    F = [[A, B], [C, D]],   G = A⁻¹B,   D − C G goes to the parent front

Order and fronts depend on the places of the blocks alone and are found once. ``fronts`` has the work itself, nearly all of it
dense products. Branches of fronts are eliminated by threads of their own; sums do not depend on how many there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import cores, in_parts, together
from orchestrator.method.interface.factor import dissection

READ = 20.0  # operations that BLAS does in single precision in the time that a solution spends on an entry of the factors
OWN_CALLS = 1e5  # operations that BLAS does in the time that one more front takes beside them
PASSED = 50.0  # operations that BLAS does in the time that it takes to pass a number on to the parent
OWN_THREAD = 1e7  # operations that BLAS does in the time that it takes to have another thread do something
LARGE = 16 * OWN_THREAD  # operations of a front that all threads share
# Rows of a share, at least, and how many shares: for each, BLAS brings what they are multiplied with into its own order once more.
ROWS, SHARES = 256, 2
MANY, ORDERS = 1e9, 8  # operations that take as long as to look for another order; of a dozen the best saves a twentieth or a tenth
PANEL = 12  # rows of a panel: at fewer products are slower, at more what is not products
BAND = 48  # rows of a band: products of so many columns are nearly as quick as others, and its inverse costs little beside them


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
        self._work: dict[np.dtype, np.ndarray] = {}
        pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, indptr), shape=(count, count))
        sees = [indices[a:b][indices[a:b] != i] for i, (a, b) in enumerate(zip(indptr[:-1], indptr[1:]))]
        groups = _grouped(sees, dissection(pattern), size)
        if _of_all(groups, size) > MANY:
            groups = min([groups, *(_grouped(sees, dissection(pattern, seed), size) for seed in range(ORDERS))],
                         key=lambda made: _of_all(made, size))
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

    @cached_property
    def layout(self) -> Layout:
        """Where factors lie, and what is done by which thread."""
        return Layout.of(self.fronts, self.size)

    def factors(self, blocks: np.ndarray, instead: Factors | None = None) -> Factors:
        """Factorise a matrix.

        Parameters
        ----------
        blocks : (n, size, size) in the order of the pattern, of either precision: that of the factors
        instead : earlier factors whose place these may take

        Raises
        ------
        ZeroDivisionError : a pivot vanishes
        """
        from orchestrator.method.coarse import fronts
        from orchestrator.method.coarse.products import PRODUCT

        at = self.layout
        if blocks.dtype not in self._work:  # fresh pages cost as much as what is done on them
            self._work[blocks.dtype] = np.empty(at.work, blocks.dtype)
        work, result = self._work[blocks.dtype], instead
        if result is None or result.own.dtype != blocks.dtype:
            result = Factors(self, np.empty(at.own, blocks.dtype), np.empty(at.beside, blocks.dtype))
        given = (PRODUCT[blocks.dtype], np.array([-1.0, 0.0, 1.0], blocks.dtype), blocks, at.panel, at.band, at.sizes, at.places,
                 at.enters, at.enter, at.children, at.child, at.rests, at.within, result.own, result.beside, work)

        def some(which: np.ndarray) -> int:
            right = np.empty(at.right[which].max(initial=0), blocks.dtype)
            return fronts.eliminate(0, len(which), fronts.WHOLE, which, 0, at.shares, given, right)

        def shared(which: np.ndarray) -> int:
            """One large front by all threads."""
            f, = which
            (a, m), (below, left) = at.sizes[f], at.shares[f].tolist()
            right = np.empty(at.right[f], blocks.dtype)
            fronts.eliminate(0, 0, fronts.ENTERED, which, 0, at.shares, given, right)
            for p in range(0, a, at.band):
                if fronts.eliminate(0, 0, fronts.ACROSS, which, p, at.shares, given, right) >= 0:
                    return f
                if p + at.band < a:
                    in_parts(fronts.eliminate, a + m - p - at.band, fronts.BELOW, which, p, at.shares, given, right, part=below)
            if m:
                in_parts(fronts.eliminate, m, fronts.LEFT, which, 0, at.shares, given, right, part=left)
            return -1

        failed = max(together(some, at.apart), default=-1)
        for which, large in at.last:
            failed = failed if failed >= 0 else (shared if large else some)(which)
        if failed >= 0:
            raise ZeroDivisionError("a pivot of the coarse contact problem vanishes")
        return result


@dataclass(frozen=True)
class Layout:
    """The fronts as ``fronts.eliminate`` wants them.

    Parameters
    ----------
    panel, band : their rows
    own, beside, work : numbers in all L, in all U, and in what is left of fronts whose parents have not taken it yet
    apart, last : the fronts that threads of their own eliminate, and those after these, a large one that all share alone
    right : (F,) int, numbers that ``fronts.eliminate`` takes beside
    others : as there
    """

    panel: int
    band: int
    sizes: np.ndarray
    places: np.ndarray
    own: int
    beside: int
    work: int
    starts: np.ndarray
    enters: np.ndarray
    enter: np.ndarray
    children: np.ndarray
    child: np.ndarray
    rests: np.ndarray
    rest: np.ndarray
    within: np.ndarray
    shares: np.ndarray
    right: np.ndarray
    apart: list[np.ndarray]
    last: list[tuple[np.ndarray, bool]]

    @classmethod
    def of(cls, fronts: Sequence[Front], size: int) -> Layout:
        """Of these fronts, whose blocks have ``size`` rows."""
        count, none, panel = len(fronts), np.zeros(0, dtype=int), max(1, PANEL // size) * size
        parent = np.array([front.parent for front in fronts], dtype=int)
        sizes = size * np.array([(front.stop - front.start, len(front.rest)) for front in fronts], dtype=int).reshape(-1, 2)
        child = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0):]
        children = np.searchsorted(parent[child], np.arange(count + 1))
        operations = np.array([_operations(own // size, rest // size, size) for own, rest in sizes], dtype=float)
        apart, last = _shared_out(parent, operations, cores())
        a, m = sizes.T
        band = max(1, BAND // panel) * panel
        large = operations > LARGE
        shares = np.array([np.where(large, -(-x // np.clip(x // ROWS, 1, SHARES)), x) for x in (a + m, m)]).T  # whoever does them
        large &= cores() > 1
        places = np.column_stack([_starts((a + m) * a)[:-1], _starts(a * m)[:-1], np.zeros(count, dtype=int)])
        begin = 0
        for some in [*apart, last]:
            places[some, 2], begin = _stacked(some, parent, m**2, begin)
        return cls(
            panel=panel, band=band, sizes=sizes, places=places, starts=np.array([f.start for f in fronts], dtype=int),
            own=int(((a + m) * a).sum()), beside=int((a * m).sum()), work=begin,
            enters=_starts([len(front.blocks) for front in fronts]),
            enter=np.column_stack([np.concatenate([none, *(getattr(front, name) for front in fronts)])
                                   for name in ("blocks", "row", "column")]),
            children=children, child=child, rests=_starts([len(front.rest) for front in fronts]),
            rest=np.concatenate([none, *(front.rest for front in fronts)]),
            within=np.concatenate([none, *(front.within for front in fronts)]),
            shares=shares, right=a * (m + np.minimum(a, band)), apart=apart,
            last=[(run, bool(large[run[0]])) for run in _runs_of(last, large)])


@dataclass
class Factors:
    """A factorised matrix.

    Parameters
    ----------
    of : order and fronts
    own, beside : the numbers, front after front
    """

    of: Elimination
    own: np.ndarray
    beside: np.ndarray

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(bodies, size) solution for a right-hand side of that shape."""
        from orchestrator.method.coarse import fronts

        result = np.empty(right.shape)
        fronts.solve(self.numbers, np.ascontiguousarray(right, float), result)
        return result

    @property
    def numbers(self) -> tuple:
        """What ``fronts.solve`` wants."""
        at = self.of.layout
        return at.band, self.of.order, at.sizes, at.places, at.starts, at.rests, at.rest, self.own, self.beside


def _starts(lengths: Sequence[int] | np.ndarray) -> np.ndarray:
    """(n + 1,) where each of some runs starts, and the end."""
    return np.concatenate([[0], np.cumsum(lengths, dtype=int)])


def _runs_of(which: np.ndarray, alone: np.ndarray) -> list[np.ndarray]:
    """Some fronts (·,) in runs, those that are to be alone by themselves."""
    cuts = [k for k in range(1, len(which)) if alone[which[k]] or alone[which[k - 1]]]
    return [run for run in np.split(which, cuts) if len(run)]


def _shared_out(parent: np.ndarray, operations: np.ndarray, threads: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Fronts (·,) that each of several threads eliminates, branches with all that is below them, and those that come after.

    The largest branch is taken apart, its own front left for later, when all share it if it is large, as long as that ends sooner.
    """
    count, below, first = len(parent), operations.copy(), np.arange(len(parent))
    for f in np.flatnonzero(parent >= 0):  # children before parents; a branch lies together, from its first front on
        below[parent[f]] += below[f]
        first[parent[f]] = min(first[parent[f]], first[f])
    branches, later, soonest, best = list(np.flatnonzero(parent < 0)), 0.0, np.inf, []
    while branches:
        shares: list[list[int]] = [[] for _ in range(threads)]
        for branch in sorted(branches, key=lambda f: -below[f]):
            min(shares, key=lambda share: below[share].sum()).append(branch)
        longest = max(below[share].sum() for share in shares)
        if longest + later < soonest - OWN_THREAD:
            soonest, best = longest + later, shares
        largest = max(branches, key=lambda f: below[f])
        if below[largest] < OWN_THREAD:
            break
        branches.remove(largest)
        branches += list(np.flatnonzero(parent == largest))
        later += operations[largest] / (threads if operations[largest] > LARGE else 1)
    apart = [np.concatenate([np.arange(first[f], f + 1) for f in sorted(share)]) for share in best if share]
    if len(apart) < 2:
        return [], np.arange(count)
    return apart, np.setdiff1d(np.arange(count), np.concatenate(apart))


def _stacked(some: np.ndarray, parent: np.ndarray, numbers: np.ndarray, begin: int) -> tuple[np.ndarray, int]:
    """(·,) where some fronts of so many numbers lie until their parents have taken what they leave, and where that ends.

    A front is put on one of two stacks, its parent on the other: there it never lies on what it is made of.
    """
    place, height, highest = np.zeros(len(parent), dtype=int), [0, 0], [0, 0]
    level = np.zeros(len(parent), dtype=int)
    for f in range(len(parent) - 1, -1, -1):
        level[f] = level[parent[f]] + 1 if parent[f] >= 0 else 0
    taken = np.bincount(parent[some][parent[some] >= 0], weights=numbers[some][parent[some] >= 0], minlength=len(parent))
    side = level % 2
    for f in some:
        height[1 - side[f]] -= int(taken[f])
        place[f] = height[side[f]]
        height[side[f]] += int(numbers[f])
        highest[side[f]] = max(highest[side[f]], height[side[f]])
    return begin + place[some] + np.where(side[some] == 0, 0, highest[0]), begin + sum(highest)


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


def _of_all(groups: Sequence[tuple[list[int], set[int], list]], size: int) -> float:
    """Operations of all fronts."""
    return sum(_operations(len(columns), len(rest), size) for columns, rest, _ in groups)


def _operations(own: int, rest: int, size: int) -> float:
    """Of a front that eliminates ``own`` bodies and leaves ``rest``."""
    a, m = own * size, rest * size
    return 2 * a**3 / 3 + 2 * a * a * m + 2 * a * m * m
