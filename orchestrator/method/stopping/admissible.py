"""Admissible fields nearby: what the error bound makes of interface data (``bound``), for perfect
interfaces.

Repositioning: where floating subdomains fit best, c = argmin ‖B N (u + R c)‖_k, six unknowns each.
A rank has those of its own subdomains and of their neighbours.

Balance: interface forces f̃ = f + δf that keep every subdomain in equilibrium,

    δf = −ω A f + ½ k B w₂,     ω + ω' = 1

The second term is what the local stage would exchange on top of balancing, opposite on both sides:
any such pair keeps f̃ balanced; this one brings the fields of f̃ closer to u. The repositioning has
made it free of resultants on floating subdomains, since both use the same weight. Where nodes do
not match, the forces of the points are those of the first side, and the second takes all of the
imbalance: forces of fewer or more nodes cannot be undone. What still pushes a floating subdomain is
balanced by the springs k B R y of motions y of all subdomains, which is the problem of the
repositioning again. The macro problem has seen to it where its basis holds the rigid motions; the
mono-scale strategy leaves it to this one.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import bounds_of, narrow, peak, ColumnSegments, times
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.spread import semidefinite
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.scene.conditions.rigid import RIGID
from orchestrator.scene.mesh.faces import runs

# Resultants above this fraction of the forces need the coarse balance: those forces are as small as
# the error, so that
# what rounding leaves of the interface forces shows; b² is known to 2 %, and smaller resultants
# change 1e-5 of it at most.
UNBALANCED = 1e-7
BALANCED = 1e-6  # of the resultants, what may be left after it
# spread, over an interface, of the ratio of both sides' stiffnesses; one matter stays below
UNEVEN = 100.0
# Of the forces κ (mean − w), what brings fields nearest to u. Bound over error with none, a
# quarter, half: 64 cubes 1.7, 1.5, 1.6; moduli 1:1000 at random 3.3, 2.8, 2.9; 128 slices 4.0, 3.0,
# 3.0.
TOGETHER = 0.25
TINY = np.finfo(float).tiny


class RigidModes:
    """Rigid motions that supports leave, of the subdomains that a rank sees: its own, and those
    that meet them.

    space : numbering
    modes : per own subdomain (boundary dofs, r), r at most six
    number : (modes,) int, ascending, which of the modes of all ranks these are
    fields : ``modes``
    dense : (6, B) on the boundary dofs, a row for the first of every subdomain, zero where it has
        fewer
    own : int, the modes of this rank's subdomains
    """

    def __init__(self, space: TraceSpace, modes: list[np.ndarray]):
        counts = np.zeros(space.link.subdomain_count)
        counts[space.subdomains] = [m.shape[1] for m in modes]
        counts = space.team.sum(counts)[0].astype(int)
        self.fields = modes
        self._space, self.dense = space, space.side_by_side(dict(enumerate(modes)), RIGID)
        self._seen = np.union1d(space.subdomains, space.owner).astype(int)
        self._starts = bounds_of(counts[self._seen])
        self.number = runs((np.cumsum(counts) - counts)[self._seen], counts[self._seen])
        self.own = np.flatnonzero(np.repeat(np.isin(self._seen, space.subdomains),
                                            counts[self._seen]))
        self._of = ColumnSegments(space.boundary)
        at = np.searchsorted(self._seen,
                             np.asarray(space.subdomains, int)[self._of.subdomains])
        there = np.arange(RIGID) < counts[self._seen[at], None]
        # (6, subdomains): −1 where there is none
        self._at = np.where(there, self._starts[at, None] + np.arange(RIGID), -1).T

    @property
    def traces(self) -> sp.csr_array:
        """(D + G, modes), formed whenever asked: twice in a run at most. All ranks have to ask."""
        traces = self._space.everywhere(self.dense)
        rows = np.ascontiguousarray(traces.T)
        there = rows != 0
        columns = (self._starts[np.searchsorted(self._seen, self._space.owner)][:, None]
                   + np.arange(RIGID))[there]
        ends = bounds_of(there.sum(axis=1))
        return narrow(sp.csr_array((rows[there], columns, ends),
                                   shape=(len(rows), self._starts[-1])))

    def moved(self, c: np.ndarray) -> np.ndarray:
        """(T, B) R c of motions (T, modes)."""
        c = np.pad(c, ((0, 0), (0, 1)))
        return sum(one * self._of.spread(c[:, at]) for one, at in zip(self.dense, self._at))

    def resultants(self, h: np.ndarray) -> np.ndarray:
        """(T, modes) Rᵀh of forces (T, B): what pushes this rank's subdomains, zero elsewhere."""
        result = np.zeros((len(h), self._starts[-1] + 1))
        for one, at in zip(self.dense, self._at):
            result[:, at] = self._of.sums(one * h)
        return result[:, :-1]


class AtPoints:
    """Both sides' k⁻ at the points, (Q, Q) symmetric: its products are those of k⁻ itself, and no
    matrix is kept.

    direction : search direction
    root : (Q,) by which it is scaled from either side
    """

    def __init__(self, direction: SearchDirection, root: np.ndarray | float = 1.0):
        self.whole, self.transfer, self.root = direction.whole, direction.space.transfer, root

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """(T, Q) products with (T, Q)."""
        transfer, traces = self.transfer, np.zeros((len(q), self.transfer.total))
        traces[:, transfer.one] = traces[:, transfer.two] = self.root * q
        found = times(self.whole, traces)
        return self.root * (found[:, transfer.one] + found[:, transfer.two])

    def matrix(self) -> sp.csr_array:
        """(Q, Q) the sparse matrix."""
        one, two = self.transfer.at_points(self.whole)
        root = sp.diags_array(np.broadcast_to(self.root, self.transfer.one.shape))
        return root @ (one + two) @ root


class Repositioning:
    """The best rigid motions for given traces.

    space : numbering
    modes : the motions
    weight : stiffness k at the points, in which jumps are measured
    """

    def __init__(self, space: TraceSpace, modes: RigidModes, weight: AtPoints):
        self.space, self.modes, self.weight = space, modes, weight
        jumps, mine = space.transfer.B @ modes.traces, space.transfer.mine
        # what is summed over the points is their first side's
        forces = (weight.matrix() @ jumps)[mine]
        self._solve = semidefinite(jumps[mine].T @ forces, modes.number, space.team)

    def __call__(self, w: np.ndarray) -> np.ndarray:
        """(T, modes) c for traces (T, D + G)."""
        return self._solve(self.modes.resultants(self.space.loads(self._closing(w))))

    def balancing(self, resultants: np.ndarray) -> np.ndarray:
        """(T, D) forces k B R y that take up resultants (T, modes)."""
        w = self.space.everywhere(self.modes.moved(self._solve(resultants)))
        return self._closing(w)

    def _closing(self, w: np.ndarray) -> np.ndarray:
        """(T, D) forces k B w of traces (T, D + G), opposite on both sides."""
        transfer = self.space.transfer
        return transfer.opposed(self.weight(transfer.jump(w)))[:, : self.space.size]


class Balancing:
    """Balanced forces of one decomposition.

    direction : search direction
    weight : (B,) stiffness of the boundary dofs
    modes : rigid motions of all subdomains
    share : (Q,) what the first side takes of a force imbalance
    soles : k of the exchange: soles are made for the stiffer side, what both can exchange is set by
        the softer one
    reposition : the best motions beside it
    """

    def __init__(self, direction: SearchDirection, weight: np.ndarray, modes: RigidModes):
        self.space, self.modes = direction.space, modes
        transfer = self.space.transfer
        trace_weight = self.space.everywhere(weight[None])
        one, two = transfer.stiffnesses(trace_weight[0])
        self.share = np.where(transfer.at_pairs, self._share(one, two), 0.0)
        self.soles = AtPoints(direction,
                              np.sqrt(np.minimum(one, two) / np.maximum(one + two, TINY)))
        self.reposition = Repositioning(self.space, modes, self.soles)

    def _share(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """(Q,) the first side's, from the stiffnesses (Q,) of both.

        The stiffer side takes the larger share: it costs less energy there. One share per interface
        keeps the resultants balanced; where stiff and soft nodes are mixed, each node has its own.
        """
        bounds = self.space.transfer.bounds
        filled = np.flatnonzero(np.diff(bounds))
        starts, counts = bounds[filled], np.diff(bounds)[filled]
        with np.errstate(over="ignore"):  # beside a side that is held
            ratio = one / np.maximum(two, TINY)
        if len(filled):
            even = np.maximum.reduceat(ratio, starts) <= UNEVEN * np.minimum.reduceat(ratio, starts)
            one, two = (np.where(np.repeat(even, counts),
                                 np.repeat(np.add.reduceat(side, starts), counts), side)
                        for side in (one, two))
        return one / np.maximum(one + two, TINY)

    def __call__(self, f: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, bool]:
        """δf (T, D) of forces and repositioned traces (T, D + G), and whether f + δf push no
        floating subdomain.
        """
        team, change = self.space.team, self._changed(f, w)
        resultant, sizes, of = self.modes.resultants(self.space.loads(change)), self.space.loads(
            np.abs(change)), ColumnSegments(self.space.boundary)
        scale = max(peak(of.sums(np.abs(one) * sizes)) for one in self.modes.dense)
        pushed, size = team.max(peak(resultant), scale)
        if pushed <= UNBALANCED * max(size, TINY):
            return change, True
        change = change + self.reposition.balancing(resultant)
        left, = team.max(peak(self.modes.resultants(self.space.loads(change))))
        return change, left <= BALANCED * max(pushed, TINY)

    def _changed(self, f: np.ndarray, w: np.ndarray) -> np.ndarray:
        """(T, D) δf of forces in balance with each other, not yet with the subdomains."""
        transfer = self.space.transfer
        q = transfer.carried(f) + 0.5 * self.soles(transfer.jump(w))
        q += (0.5 * transfer.at_pairs - self.share) * (transfer.first(f) + transfer.second(f))
        return (transfer.opposed(q) - f)[:, : self.space.size]


class NodeRepositioning(Repositioning):
    """The best rigid motions where a scene is solved by nodes, c = argmin Σ κ |w + R c − m|² over
    the copies of nodes, m their common displacement. On borders between ranks m is an unknown too.

    rigid : per own subdomain (boundary dofs, r), its motions
    weight : (B,) κ
    """

    def __init__(self, space: TraceSpace, modes: RigidModes, rigid: list[np.ndarray],
                 weight: np.ndarray):
        self.space, self.modes, self.weight = space, modes, weight
        self.total, border = space.class_sums(weight[None])[0], space.on_borders
        moved = space.classes @ sp.diags_array(weight) @ sp.block_diag([np.zeros((0, 0)), *rigid])
        inside, across = moved[~border], moved[border]
        own = sp.block_diag([
            R.T @ (weight[part, None] * R) for R, part in zip(rigid, space.boundary)])
        own = own - inside.T @ sp.diags_array(1 / self.total[~border]) @ inside
        here = sp.diags_array((space.classes @ weight)[border])
        means = RIGID * space.link.subdomain_count + space.labels[border]
        number = np.concatenate([modes.number[modes.own], means])
        part = sp.csr_array(sp.block_array([[own, -across.T], [-across, here]]))
        self._common, self._count = semidefinite(part, number, space.team), len(number)

    def _solve(self, resultants: np.ndarray) -> np.ndarray:
        """(T, modes) motions, of this rank's subdomains alone, that resultants (T, modes) cause."""
        part, result = np.zeros((len(resultants), self._count)), np.zeros_like(resultants)
        own = self.modes.own
        part[:, : len(own)] = resultants[:, own]
        result[:, own] = self._common(part)[:, : len(own)]
        return result

    def _closing(self, w: np.ndarray) -> np.ndarray:
        """(T, B) forces κ (mean − w) of traces (T, B + G)."""
        w = w[:, : self.space.size]
        mean = self.space.class_sums(self.weight * w) / self.total
        return self.weight * (mean.take(self.space.label, axis=1) - w)


class NodeBalancing(Balancing):
    """Balanced forces where a scene is solved by nodes: each copy of a node takes its share κ/Σκ of
    the imbalance Σf, and some of what would bring the copies together.

    Parameters as of the base class.
    """

    def __init__(self, direction: SearchDirection, weight: np.ndarray, modes: RigidModes):
        self.space, self.modes = direction.space, modes
        self.reposition = NodeRepositioning(self.space, modes, modes.fields, weight)
        self.share = weight / self.reposition.total.take(self.space.label)

    def _changed(self, f: np.ndarray, w: np.ndarray) -> np.ndarray:
        space = self.space
        imbalance = space.class_sums(f[:, : space.size]).take(space.label, axis=1)
        return TOGETHER * self.reposition._closing(w) - self.share * imbalance
