"""Fields of the coarse problem where pairs of several bodies answer together, see
``interface.node_stage``: what they change.

    db = D y,  D = B (N W / copies − C N F)
    what forces answer:  X D y,  X = J⁻¹ A keq,  J as in ``interface.node_newton``

A group's bodies all feel each other: Tᵀ X D has blocks beside those of interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.compiled import in_parts
from orchestrator.method.coarse.load_step import Bodies
from orchestrator.method.coarse.responses import Responses
from orchestrator.method.interface.node_groups import NodeGroups, pointwise, stiffness
from orchestrator.method.interface.node_newton import PULLS
from orchestrator.method.interface.rows import bounds_of, rows_of, times


@dataclass(frozen=True)
class GroupFields:
    """Fields at R points of groups.

    groups : the groups
    chosen : (r,) int, which of the coarse problem's pairs the first r of the points are
    Z : (n, 3M) what a field of each node's own body does to it; owner : (3M,) int, that body
    ends : (R, 2) int, the two bodies of each point, the lower first
    T : (R, 3, 2, n) fields of these, zero at points that other ranks add up
    pairs : (I, 2) int, pairs of bodies that have blocks: those of the rank's interfaces come first
    count : bodies of all ranks
    """

    groups: NodeGroups
    chosen: np.ndarray
    Z: np.ndarray
    owner: np.ndarray
    ends: np.ndarray
    T: np.ndarray
    pairs: np.ndarray
    count: int

    @classmethod
    def of(cls, groups: NodeGroups, bodies: Bodies, response: Responses) -> GroupFields:
        """Return the fields; all ranks ask together."""
        fields, size = bodies.fields, groups.sums.shape[1]
        own = times(groups.sums,
                    response.W[:, :size]) / groups.copies - times(
                        groups.C, times(groups.sums, response.F[:, :size]))
        nodes, traces = groups.sums.tocoo().coords
        owner = np.zeros(len(groups.copies))
        owner[nodes] = response.space.owner[traces]
        own = np.vstack([own, owner])
        *Z, owner = np.hstack([own, *groups.nodes(own)])
        owner, B = owner.astype(int), groups.B.tocoo()
        R = B.shape[0] // 3
        ends = np.full((R, 2), [np.iinfo(int).max, -1])
        point, side = B.coords[0] % R, owner[B.coords[1]]
        np.minimum.at(ends[:, 0], point, side)
        np.maximum.at(ends[:, 1], point, side)
        T, chosen = np.zeros((R, 3, 2, fields.size)), fields.pairs.together[groups.chosen]
        here = np.repeat(fields.ends, np.diff(fields.pairs.bounds), axis=0)[chosen]
        ends[: len(chosen)] = np.sort(here, axis=1)
        ends[ends[:, 1] < 0] = 0  # what other ranks have slid off
        T[: len(chosen)] = fields.some(chosen).T.reshape(-1, 3, 2, fields.size)
        turned = np.flatnonzero(here[:, 0] > here[:, 1])
        T[turned] = T[turned][:, :, ::-1]
        T[: len(chosen)][~bodies.theirs[chosen]] = 0.0
        first, body, _ = _bodies_of(groups.group, ends, fields.count)
        rows, columns = _each_two(first)
        both = np.sort(np.column_stack([body[rows], body[columns]]), axis=1)
        here = fields.ends[bodies.counted]
        known = fields.count * here.min(axis=1, initial=fields.count) + here.max(axis=1, initial=-1)
        extra = np.unique(both[both[:, 0] < both[:, 1]], axis=0)
        extra = extra[~np.isin(extra @ [fields.count, 1], known)]
        return cls(groups, chosen, np.array(Z), owner, ends, T, np.concatenate([here, extra]),
                   fields.count)

    def moved(self, y: np.ndarray) -> np.ndarray:
        """Return db (3, R) of fields y (bodies, n)."""
        z = (self.Z * y[self.owner].T).sum(axis=0)
        return (self.groups.B @ z).reshape(3, -1)

    @cached_property
    def D(self) -> np.ndarray:
        """(R, 3, 2, n), bodies as in ``ends``."""
        B = self.groups.B.tocoo()
        R, result = len(self.ends), []
        for side in range(2):
            ours = self.owner[B.coords[1]] == self.ends[B.coords[0] % R, side]
            if side:
                ours &= self.ends[B.coords[0] % R, 0] != self.ends[B.coords[0] % R, 1]
            part = sp.csr_array((B.data[ours], tuple(x[ours] for x in B.coords)), shape=B.shape)
            result.append((part @ self.Z.T).reshape(3, R, -1))
        return np.stack(result, axis=2).transpose(1, 0, 2, 3).copy()

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, ...]:
        """Where the bodies of each group begin (n + 1,), which of them a point's two are (R, 2),
        where the block of two of them is (·,), and where those of each group begin (n,)."""
        N = self.count
        first, body, local = _bodies_of(self.groups.group, self.ends, N)
        rows, columns = _each_two(first)
        a, b = body[rows], body[columns]
        numbers = self.pairs.min(axis=1) * N + self.pairs.max(axis=1)
        order = np.argsort(numbers, kind="stable")
        home = np.zeros(N, int)
        home[self.pairs.ravel()[::-1]] = np.repeat(np.arange(len(self.pairs)), 2)[::-1]
        wanted = np.searchsorted(numbers[order], np.minimum(a, b) * N + np.maximum(a, b))
        pair = np.where(a == b, home[a], order[np.minimum(wanted, len(order) - 1)])
        spots = 4 * pair + 2 * (self.pairs[pair, 0] != a) + (self.pairs[pair, 0] != b)
        return first, local, spots, bounds_of(np.diff(first) ** 2)[:-1]

    @cached_property
    def _stiff(self) -> np.ndarray:
        """(3, 3, R) keq."""
        return stiffness(self.groups.laws)

    @cached_property
    def _quick(self) -> tuple[tuple, ...]:
        """Groups that compiled loops answer, their bodies, and the fields at their points, as the
        loop takes them.
        """
        quick, (first, local, spots, begins) = self.groups.contact, self._blocks
        at, which = quick.order, np.flatnonzero(quick.quick)
        return ((quick.bounds, quick.places, quick.matrices),
                (bounds_of(np.diff(first)[which]), local[at], spots, begins[which]),
                (self.T[at], self.D[at]))

    @cached_property
    def _others(self) -> tuple[np.ndarray, sp.csr_array, np.ndarray]:
        """Points (Q,) int of the other groups, 1 − keq S of these, and D (Q, 3, b, n) for each body
        of their group.
        """
        at, (first, local, _,
             _) = np.flatnonzero(~self.groups.contact.quick[self.groups.group]), self._blocks
        dofs, each = rows_of(at, len(self.ends)), np.diff(first)[self.groups.group[at]]
        D = np.zeros((len(at), 3, each.max(initial=0), self.T.shape[3]))
        for side in range(2):
            D[np.arange(len(at)), :, local[at, side]] += self.D[at, :, side]
        return at, self.groups.felt[dofs][:, dofs], D

    def add(self, slope: np.ndarray, result: np.ndarray) -> None:
        """Add Tᵀ X D to blocks (I, 2, 2, n, n) of ``pairs``; slope : (3, 3, R) A."""
        from orchestrator.method.interface.node_loops import added

        blocks, at = result.reshape(-1, *result.shape[3:]), self.groups.contact.order
        if len(at):
            groups, bodies, fields = self._quick
            in_parts(added, len(groups[1]), groups, bodies, fields,
                     (slope[:, :, at].copy(), self._stiff[:, :, at].copy()), PULLS[0], blocks,
                     part=len(groups[1]))
        if len(at) < len(self.ends):
            self._add_others(slope, blocks)

    def _add_others(self, slope: np.ndarray, blocks: np.ndarray) -> None:
        """The same of groups that no loop answers; blocks (·, n, n)."""
        (at, felt, D), (first, local, spots, begins) = self._others, self._blocks
        slope, number = slope[:, :, at], self.groups.group[at]
        one = sp.eye_array(3 * len(at))
        J = one - pointwise(slope) @ (felt - PULLS[0] * one)
        right = np.einsum("cdp,dep,pebf->cpbf", slope, self._stiff[:, :, at], D, optimize=True)
        XD = sla.splu(sp.csc_array(J)).solve(right.reshape(3 * len(at), -1)).reshape(right.shape)
        product = np.einsum("pcsf,cpbh->psbfh", self.T[at], XD, optimize=True)
        count = np.diff(first)[number]
        for side in range(2):
            for body in range(D.shape[2]):
                there = np.flatnonzero(body < count)
                spot = begins[number[there]] + local[at[there], side] * count[there] + body
                np.add.at(blocks, spots[spot], product[there, side, body])


def _bodies_of(group: np.ndarray, ends: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """Return where the bodies of each group begin (n + 1,), which they are (·,), and which of
    their group's a point's two are (R, 2).

    group : (R,) int, each point's; ends : (R, 2) int, of ``count`` bodies
    """
    keys, local = np.unique(group[:, None] * count + ends, return_inverse=True)
    own, body = np.divmod(keys, count)
    first = np.searchsorted(own, np.arange(own.max(initial=-1) + 2))
    return first, body, local.reshape(-1, 2) - first[group][:, None]


def _each_two(first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns (Σ count²,) int of all pairs of a group's own entries.

    first : (n + 1,) int, where those of each group begin
    """
    first, count = first[:-1], np.diff(first)
    square = count**2
    within = np.arange(square.sum()) - np.repeat(bounds_of(square)[:-1], square)
    first, count = np.repeat(first, square), np.repeat(count, square)
    return first + within // count, first + within % count
