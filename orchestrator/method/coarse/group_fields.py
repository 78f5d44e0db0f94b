"""What the coarse problem's fields change where pairs of several bodies answer together, see
``interface.node_stage``.

    db = D y,  D = B (N W / copies − C N F);      what forces answer:  X D y,  X = J⁻¹ A keq,  J = 1 − (1 − δ) A (1 − keq S)

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
from orchestrator.method.interface.rows import rows_of, times

SHIFT = 1e-6  # δ: with friction J may be singular


@dataclass(frozen=True)
class GroupFields:
    """Fields at R points of groups.

    groups : the groups
    Z : (n, 3M) what a field of each node's own body does to it; owner : (3M,) int, that body
    ends : (R, 2) int, the two bodies of each point, the lower first
    T : (R, 3, 2, n) fields of these, zero at points that other ranks add up
    pairs : (I, 2) int, pairs of bodies that have blocks: those of the rank's interfaces come first
    """

    groups: NodeGroups
    Z: np.ndarray
    owner: np.ndarray
    ends: np.ndarray
    T: np.ndarray
    pairs: np.ndarray

    @classmethod
    def of(cls, groups: NodeGroups, bodies: Bodies, response: Responses) -> GroupFields:
        """Return the fields; all ranks ask together."""
        fields, size, count = bodies.fields, groups.sums.shape[1], len(groups.copies)
        own = times(groups.sums, response.W[:, :size]) / groups.copies - times(groups.C, times(groups.sums, response.F[:, :size]))
        body = np.zeros(count)
        body[sp.coo_array(groups.sums).coords[0]] = response.space.owner[sp.coo_array(groups.sums).coords[1]]
        own = np.vstack([own, body])
        *Z, owner = np.hstack([own, *groups.nodes(own)])
        owner, B = owner.astype(int), groups.B.tocoo()
        R = B.shape[0] // 3
        ends = np.full((R, 2), [np.iinfo(int).max, -1])
        point, side = B.coords[0] % R, owner[B.coords[1]]
        np.minimum.at(ends[:, 0], point, side)
        np.maximum.at(ends[:, 1], point, side)
        T, chosen = np.zeros((R, 3, 2, fields.size)), groups.chosen
        here = np.repeat(fields.ends, np.diff(fields.pairs.bounds), axis=0)[chosen]
        ends[: len(chosen)] = np.sort(here, axis=1)
        ends[ends[:, 1] < 0] = 0  # what other ranks have slid off
        T[: len(chosen)] = fields.some(chosen).T.reshape(-1, 3, 2, fields.size)
        turned = np.flatnonzero(here[:, 0] > here[:, 1])
        T[turned] = T[turned][:, :, ::-1]
        T[: len(chosen)][~bodies.theirs[chosen]] = 0.0
        met = np.unique(np.column_stack([np.repeat(groups.group, 2), ends.ravel()]), axis=0)
        first, total = np.unique(met[:, 0], return_index=True, return_counts=True)[1:]
        rows, columns = _each_two(first, total)
        both = np.sort(np.column_stack([met[rows, 1], met[columns, 1]]), axis=1)
        here = fields.ends[bodies.counted]
        known = fields.count * here.min(axis=1, initial=fields.count) + here.max(axis=1, initial=-1)
        extra = np.unique(both[both[:, 0] < both[:, 1]], axis=0)
        extra = extra[~np.isin(extra @ [fields.count, 1], known)]
        return cls(groups, np.array(Z), owner, ends, T, np.concatenate([here, extra]))

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
        where the block of two of
        them is (·,), and where those of each group begin (n,)."""
        N = int(max(self.ends.max(initial=0), self.pairs.max(initial=0))) + 1
        keys, local = np.unique(self.groups.group[:, None] * N + self.ends, return_inverse=True)
        group, body = np.divmod(keys, N)
        first = np.searchsorted(group, np.arange(group.max(initial=-1) + 2))
        local = local.reshape(-1, 2) - first[self.groups.group][:, None]
        rows, columns = _each_two(first[:-1], np.diff(first))
        a, b = body[rows], body[columns]
        low, high = self.pairs.min(axis=1), self.pairs.max(axis=1)
        order = np.argsort(low * N + high, kind="stable")
        home = np.zeros(N, int)
        home[self.pairs.ravel()[::-1]] = np.repeat(np.arange(len(self.pairs)), 2)[::-1]
        known = (low * N + high)[order]
        pair = order[np.minimum(np.searchsorted(known, np.minimum(a, b) * N + np.maximum(a, b)), len(known) - 1)]
        pair = np.where(a == b, home[a], pair)
        spots = 4 * pair + 2 * (self.pairs[pair, 0] != a) + (self.pairs[pair, 0] != b)
        return first, local, spots, np.cumsum(np.diff(first) ** 2) - np.diff(first) ** 2

    def add(self, slope: np.ndarray, result: np.ndarray) -> None:
        """Add Tᵀ X D to blocks (I, 2, 2, n, n) of ``pairs``; slope : (3, 3, R) A."""
        from orchestrator.method.interface.node_loops import added

        quick, stiff, blocks = self.groups.contact, stiffness(self.groups.laws), result.reshape(-1, *result.shape[3:])
        first, local, spots, begins = self._blocks
        if len(quick.order):
            at, which = quick.order, np.flatnonzero(quick.quick)
            bounds = np.concatenate([[0], np.cumsum(np.diff(first)[which])])
            in_parts(added, len(which), (quick.bounds, quick.places, quick.matrices), (bounds, local[at], spots, begins[which]),
                     (self.T[at], self.D[at]), (slope[:, :, at].copy(), stiff[:, :, at].copy()), SHIFT, blocks, part=len(which))
        others = np.flatnonzero(~quick.quick[self.groups.group])
        if not len(others):
            return
        dofs, number = rows_of(others, len(self.ends)), self.groups.group[others]
        felt = self.groups.felt[dofs][:, dofs]
        J = sp.eye_array(len(dofs)) - pointwise((1 - SHIFT) * slope[:, :, others]) @ felt
        each, size = int(np.diff(first)[number].max()), self.T.shape[3]
        D = np.zeros((len(others), 3, each, size))
        for side in range(2):
            D[np.arange(len(others)), :, local[others, side]] += self.D[others, :, side]
        right = np.einsum("cdp,dep,pebf->cpbf", slope[:, :, others], stiff[:, :, others], D, optimize=True)
        XD = sla.splu(sp.csc_array(J)).solve(right.reshape(len(dofs), -1)).reshape(3, len(others), each, size)
        product = np.einsum("pcsf,cpbh->psbfh", self.T[others], XD, optimize=True)
        count = np.diff(first)[number]
        for side in range(2):
            for body in range(each):
                there = np.flatnonzero(body < count)
                spot = spots[begins[number[there]] + local[others[there], side] * count[there] + body]
                np.add.at(blocks, spot, product[there, side, body])


def _each_two(first: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns (Σ count²,) int of all pairs of a group's own entries, which begin
    at ``first``.
    """
    square = count**2
    within = np.arange(square.sum()) - np.repeat(np.cumsum(square) - square, square)
    first, count = np.repeat(first, square), np.repeat(count, square)
    return first + within // count, first + within % count
