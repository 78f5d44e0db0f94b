"""The groups in which a rank's points answer together, and the nodes of bodies that feel them.

Points that S couples are a group, see ``node_points``: those that share a node where nodes match;
where they do not, all of an interface, and of interfaces that share a node with it. A pair of nodes
that no other point shares has S = 1/keq, and is no group: its law answers at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.answering import LawPoints
from orchestrator.method.interface.node_contact import ContactGroups
from orchestrator.method.interface.node_points import labelled, NodePoints, nodewise
from orchestrator.method.interface.node_visits import completed, places, Visits
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.rows import rows_of
from orchestrator.method.interface.traces import TraceSpace


@dataclass(frozen=True)
class NodeGroups:
    """The groups that a rank answers: all that have a point of its own.

    chosen : (r,) int, ascending, which of the rank's pairs have a group; they are the first of R
        points
    behind : (R − r,) int, which of the points that other ranks tell of have
    laws : what the points answer; slid : (3, R) what B w lacks of their jumps
    group : (R,) int, of n groups, which is each point's
    first : (n,) int, which of the rank's pairs each one's first point is; −1: it is another rank's
    sums : (3m, D) N of this rank's nodes; copies : (3m,) traces of each node's component
    reached : (3m,) bool, those that a point of a group acts on; the others are told to other ranks
        alone
    C : (3m, 3m) compliance of these
    B : (3R, 3M) B Nᵀ, component after component of the points; this rank's nodes are the first of M
    felt : (3R, 3R) 1 − keq S
    points, nodes : how values come from other ranks' pairs, and from components of their nodes
    """

    chosen: np.ndarray
    behind: np.ndarray
    laws: LawPoints
    slid: np.ndarray
    group: np.ndarray
    first: np.ndarray
    sums: sp.csr_array
    copies: np.ndarray
    reached: np.ndarray
    C: sp.csr_array
    B: sp.csr_array
    felt: sp.csr_array
    points: Visits
    nodes: Visits

    @classmethod
    def of(cls, space: TraceSpace, pairs: Pairs) -> NodeGroups | None:
        """Return the groups; None where each point is alone at its nodes. All ranks ask
        together.
        """
        own, sums = NodePoints.of(space, pairs)
        known, points, nodes = completed(own, space.team)
        count, label = len(own.point), labelled(known.B, known.C.any(axis=(1, 2)))
        # other ranks tell of points between them and this one, too
        new = np.arange(len(label)) < count
        new |= places(own.point, known.point) < 0
        grouped = known.apart | (np.bincount(label[new],
                                             minlength=len(known.node) + len(label))[label] > 1)
        chosen = np.flatnonzero(new & grouped & np.isin(label, label[:count]))
        B = sp.csr_array(known.B[rows_of(chosen, len(known.point))])
        reached = np.isin(np.arange(len(known.node)), B.indices // 3)
        if not space.team.max(float(reached.any()))[0]:  # or sides have slid off each other
            return None
        mine, kept = int(known.own.sum()), reached | ~known.own
        kept[nodes.sends] = True
        B = sp.csr_array(B[:, nodewise(np.flatnonzero(kept))])
        S = sp.csr_array(B @ block_diagonal(known.C[kept]) @ B.T)
        laws, here = known.laws.alone(chosen), np.flatnonzero(kept[:mine])
        felt = sp.csr_array(sp.eye_array(S.shape[0]) - pointwise(stiffness(laws)) @ S)
        sums = sp.csr_array(sums[nodewise(np.flatnonzero(own.own)[here])])
        group = np.unique(label[chosen], return_inverse=True)[1].ravel()
        turn = np.lexsort((*known.point[chosen].T[::-1], group))  # on all ranks the same one first
        first = chosen[turn[np.flatnonzero(np.diff(group[turn], prepend=-1))]]
        told = (first < count) & known.mine[first]
        return cls(own.place[chosen[chosen < count]], chosen[chosen >= count] - count, laws,
                   known.slid[:, chosen], group,
                   np.where(told, own.place[np.where(told, first, 0)], -1), sums,
                   np.maximum(sums.sum(axis=1), 1),
                   np.repeat(reached[here], 3), block_diagonal(known.C[here]), B, felt, points,
                   replace(nodes, sends=nodewise(np.searchsorted(here, nodes.sends)),
                           counts={r: 3 * count for r, count in nodes.counts.items()}))

    @cached_property
    def Bt(self) -> sp.csr_array:
        """(3m, 3R) the transpose of B, at this rank's nodes."""
        return sp.csr_array(self.B.T[: len(self.copies)])

    @cached_property
    def contact(self) -> ContactGroups:
        """Groups that compiled loops answer."""
        return ContactGroups.of(self.laws, self.group, self.felt)

    @cached_property
    def back(self) -> sp.csr_array:
        """(D, 3m) Nᵀ."""
        return sp.csr_array(self.sums.T)

    @cached_property
    def traces(self) -> np.ndarray:
        """(k,) int, traces of nodes that points of groups act on."""
        return np.unique(self.sums[self.reached].indices)

    @cached_property
    def members(self) -> np.ndarray:
        """(n,) int, points of each group."""
        return np.bincount(self.group)


def stiffness(laws: LawPoints) -> np.ndarray:
    """Return (3, 3, R) keq of points, zero where components are prescribed."""
    points = laws.points
    return np.where(laws.free[:, None] & laws.free[None],
                    points.blocks(points.stiff_n, points.stiff_t), 0.0)


def pointwise(each: np.ndarray) -> sp.csr_array:
    """Return the sparse (3R, 3R) matrix with blocks (3, 3, R), component after component."""
    dof = np.arange(each[0].size).reshape(each.shape[1:])
    rows, columns = (np.broadcast_to(x, each.shape).ravel() for x in (dof[:, None], dof[None]))
    return sp.csr_array((each.ravel(), (rows, columns)), shape=(dof.size, dof.size))


def block_diagonal(blocks: np.ndarray) -> sp.csr_array:
    """Return (3n, 3n) with blocks (n, 3, 3) on the diagonal."""
    count = len(blocks)
    return sp.csr_array(sp.bsr_array((blocks, np.arange(count), np.arange(count + 1)),
                                     shape=(3 * count, 3 * count)))
