"""Sparse matrices of dense blocks, of bodies and the interfaces between them, eliminated front
after front (multifrontal method).

Bodies are ordered by nested dissection (Karypis & Kumar, SIAM J. Sci. Comput. 20, 1998). Bodies
that are eliminated one after the other and see much the same bodies make a *front*, one dense
matrix of the bodies that it eliminates and of those that these see among the ones to come (Duff &
Reid, ACM Trans. Math. Softw. 9, 1983):

    F = [[A, B], [C, D]],   G = A⁻¹B,   D − C G goes to the parent front

Order and fronts depend on the places of the blocks alone and are found once. ``fronts`` has the
work itself, nearly all of it dense products. SuperLU takes four to six times as long, in this order
as well: matrices of 125 and 343 rigid bodies 2.9 and 30 ms in place of 0.7 and 6.1; the same fronts
with numpy 2.6 and 30 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import cores, in_parts
from orchestrator.method.coarse.layout import Layout, side_by_side, SideBySide
from orchestrator.parallel.team import ALONE, Team
from orchestrator.linalg import dissection
from orchestrator.method.interface.rows import bounds_of

OWN_CALLS = 1e5  # operations that BLAS does in the time that one more front takes beside them
# operations that BLAS does in the time that it takes to pass a number on to the parent
PASSED = 50.0
# operations of an elimination, from which GMRES beside a smaller one is quicker: of some 200 bodies
WORTH = 3e8


class Elimination:
    """Order and fronts for one pattern.

    indptr, indices : the pattern, block row after block row, symmetric, with the diagonal
    size : rows of a block; those that are eliminated, which are the first ``rigid`` alone where
        that saves much
    order : (bodies,) int, in which they are eliminated; place : (bodies,) int, where each is in it
    fronts : (F, 2) int, how many bodies each eliminates, and how many these see among the ones to
        come
    layout : where they lie, those that are this rank's
    shared : which are whose
    entered : (n,) bool, the blocks that enter this rank's fronts; each enters one
    operations : of an elimination
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray, size: int, team: Team = ALONE,
                 rigid: int = 0):
        count, self.team = len(indptr) - 1, team
        pattern = sp.csr_array((np.ones(len(indices), np.int8), indices, indptr),
                               shape=(count, count))
        sees = [indices[a:b][indices[a:b] != i]
                for i, (a, b) in enumerate(zip(indptr[:-1], indptr[1:]))]
        order, hands = team.share(None if team.rank else (dissection(pattern), cores()))
        groups = grouped(sees, order, size)
        if rigid and sum(operations(len(columns), len(rest), size)
                         for columns, rest, _ in groups) >= WORTH:
            groups, size = grouped(sees, order, rigid), rigid
        self.size = size
        self.order = np.array([body for columns, _, _ in groups for body in columns], dtype=int)
        self.fronts = np.array([(len(columns), len(rest)) for columns, rest, _ in groups],
                               dtype=int).reshape(-1, 2)
        self.place = place = np.argsort(self.order)
        rests = [np.sort(place[np.array(sorted(rest), dtype=int)]) for _, rest, _ in groups]
        entries = place[np.repeat(np.arange(count), np.diff(indptr))], place[indices]
        self.layout = Layout.of(self.fronts, rests, entries, size)
        each, parent = np.array([operations(*front, size)
                                 for front in self.fronts]), self.layout.parent
        self.operations = each.sum()
        self.shared = side_by_side(parent, each, hands, team.size)
        rank, inside = self.shared.rank, np.isin(np.arange(len(parent)), self.shared.above,
                                                 invert=True)
        tops = np.flatnonzero(inside & (parent >= 0) & ~inside[parent]
                              & (self.layout.sizes[:, 1] > 0))
        here = np.repeat((rank == team.rank)[:, None], 3, axis=1)
        here[tops, 2] |= team.rank == 0  # what subtrees leave comes to it
        self.layout, self._room = self.layout.placed(here)
        self._handed = [[self._left(f) for f in tops if rank[f] == r] for r in range(team.size)]
        self.owner = np.empty(count, dtype=int)
        self.owner[self.order] = np.repeat(rank, self.fronts[:, 0])
        enter = self.layout.enter
        front = np.repeat(np.arange(len(rank)), np.diff(self.layout.enters))
        mine = rank[front] == team.rank
        self.entered = np.zeros(len(enter), dtype=bool)
        self.entered[enter[mine, 0]] = True
        enter[:, 0] = np.cumsum(self.entered)[enter[:, 0]] - 1  # of those that this rank has
        self._enters = np.empty(self.entered.sum(), int)  # front that each of them enters
        self._enters[enter[mine, 0]] = front[mine]
        self._work: np.ndarray | None = None

    def _left(self, front: int) -> slice:
        """Where what a front leaves is in what is worked on."""
        start = self.layout.places[front, 2]
        return slice(start, start + self.layout.sizes[front, 1] ** 2)

    @property
    def above(self) -> np.ndarray:
        """(k,) int, places in the order of elimination of bodies in fronts above all subtrees."""
        return np.flatnonzero(np.repeat(np.isin(np.arange(len(self.fronts)), self.shared.above),
                                        self.fronts[:, 0]))

    @property
    def spread(self) -> bool:
        """Whether other ranks than rank 0 have fronts."""
        return self.shared.ranks[1] < self.shared.ranks[-1]

    def factors(self, blocks: np.ndarray, instead: Factors | None = None,
                stale: np.ndarray | None = None) -> Factors:
        """Factorise a matrix; each rank its own fronts, all at the same time.

        blocks : (k, size, size) those ``entered`` into this rank's fronts, in the order of the
            pattern
        instead : earlier factors whose place these may take
        stale : (k,) bool, blocks that are others than in these, which were the last ones; default:
            all
        Raises ZeroDivisionError: a pivot vanishes
        """
        from orchestrator.method.coarse.fronts import eliminate
        from orchestrator.method.coarse.front_solves import PRODUCT

        if not len(blocks):
            return Factors(self, np.empty(0), np.empty(0))
        order, bounds, ranks = self.shared if stale is None else self._stale(stale)
        result, mine = instead, ranks[self.team.rank : self.team.rank + 2]
        if self._work is None:  # fresh pages cost as much as what is done on them
            self._work = np.empty(self._room[2])
        if result is None:
            result = Factors(self, np.empty(self._room[0]), np.empty(self._room[1]))
        given = PRODUCT, blocks, tuple(self.layout), (result.own, result.beside, self._work)
        try:
            if mine[1] > mine[0]:
                in_parts(eliminate, mine[1] - mine[0], *given, (order, bounds[mine[0] :]), part=1)
            if self.spread:
                self._hand_up()
            if self.team.rank == 0:
                eliminate(len(bounds) - 2, len(bounds) - 1, *given, (order, bounds))
        except np.linalg.LinAlgError as error:
            raise ZeroDivisionError("a pivot of the coarse contact problem vanishes") from error
        return result

    def _stale(self, blocks: np.ndarray) -> SideBySide:
        """Return what is left to do where some of the blocks (k,) bool have changed: their fronts,
        and all
        above these.
        """
        order, bounds, ranks = self.shared
        stale = np.zeros(len(order), bool)
        stale[self._enters[blocks]] = True
        if self.spread:  # other ranks' may have
            stale[self.shared.above] = True
        for front, parent in enumerate(self.layout.parent):  # which comes later
            stale[parent] |= stale[front] and parent >= 0
        kept = stale[order]
        return SideBySide(order[kept], bounds_of(kept)[bounds], ranks)

    def _hand_up(self) -> None:
        """Send rank 0 what the subtrees of other ranks leave."""
        work, team, none = self._work, self.team, [np.empty(0)]
        if team.rank:
            if mine := self._handed[team.rank]:
                team.exchange({0: np.concatenate([work[at] for at in mine])}, {})
            return
        room = {rank: np.concatenate([*none, *(work[at] for at in each)])
                for rank, each in enumerate(self._handed) if rank and each}
        for rank, arrived in team.exchange({}, room).items():
            for at in self._handed[rank]:
                length = at.stop - at.start
                work[at], arrived = arrived[:length], arrived[length:]


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
        """(bodies, size) solution for a right-hand side of that shape, which all ranks have; on all
        ranks.
        """
        from orchestrator.method.coarse.front_solves import backward, forward

        of, team = self.of, self.of.team
        given, x = (tuple(of.layout), self.own,
                    self.beside), np.array(right[of.order], float, order="C")
        if not of.spread:
            if team.rank == 0:
                for work in (forward, backward):
                    work(np.arange(len(of.fronts)), given, x)
            return team.spread(x[of.place])
        mine, above, top, others = of.shared.own(team.rank), of.shared.above, of.above, of.owner[
            of.order] != team.rank
        x[others] = 0.0
        forward(mine, given, x)
        x[top], = team.sum(x[top])
        if team.rank == 0:
            forward(above, given, x)
            backward(above, given, x)
        x[top] = team.spread(x[top])
        backward(mine, given, x)
        x[others] = 0.0
        return team.sum(x)[0][of.place]


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
