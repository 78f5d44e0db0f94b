"""The laws of pairs that share nodes of bodies, answered together, group by group.

``node_newton`` finds q = law(q + keq (b − S q)), b = B (w − C f_b), step by step from the forces
that the traces bring with them. Several answers q may do where pairs form a circle: what begins
near one stays there. What a body's node then lacks is g = f_b + Bᵀ q.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.interface.answering import History
from orchestrator.method.interface.node_groups import NodeGroups
from orchestrator.method.interface.node_newton import Question, solved
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.rows import times

ENOUGH = 0.02  # of the rms of g: an answer on the way need not be better
ROUNDING = 1e-12  # of the largest force


class NodeStage:
    """The groups' answers to fields, load step after load step.

    groups, pairs : the groups, and all pairs of the rank
    w, f : (T, D + G) traces of the linear stage
    before : what the load step before has left at all pairs
    anchors : (T, 3, P) jumps at which springs of stabilisation carry nothing; None: those of the
        load step before
    left : (2, T) sum of the squares of what this rank's nodes lack, and how many components these
        are
    rms : (T,) of all ranks; whoever asks for answers gives it first
    unsolved : (T, P) bool, pairs of which each stands for a group whose laws did not come to hold
    question, after : what was asked last, and what that leaves to the next load step
    """

    def __init__(self, groups: NodeGroups, pairs: Pairs, w: np.ndarray, f: np.ndarray,
                 before: History,
                 anchors: np.ndarray | None):
        self.groups, self.numbers, steps = groups, pairs.numbers, len(w)
        self.unsolved = np.zeros((steps, len(pairs)), bool)
        size = groups.sums.shape[1]
        self.f_b = times(groups.sums, f[:, :size])
        z = times(groups.sums, w[:, :size]) / groups.copies - times(groups.C, self.f_b)
        self.b = times(groups.B,
                       np.hstack([z, *groups.nodes(z)])).reshape(steps, 3, -1) + groups.slid
        self.q, self.before, self.anchors = _met(groups, pairs, pairs.transfer.carried(f), before,
                                                 anchors)
        left = self._lacks(self.q)
        self.left = np.stack([(left**2).sum(axis=1), np.full(steps, groups.reached.sum())])
        self.rms = np.zeros(steps)

    def _lacks(self, q: np.ndarray) -> np.ndarray:
        """(T, 3m) f_b + Bᵀ q of this rank's nodes, q (T, 3, R)."""
        return self.groups.reached * (self.f_b + times(self.groups.Bt, q.reshape(len(q), -1)))

    def predicted(self, t: int, moved: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return F (3, r), at which the laws of each of the rank's pairs alone answer what all
        answer together, and jumps.

        t : of the load steps here, one after the other; who asks passes ``after`` on to ``before``
        moved : (3, R) by which b is another than that of the traces
        """
        groups, before = self.groups, self.before
        anchor = before.jump if self.anchors is None else self.anchors[t]
        number, start = self.numbers[t], groups.laws.masked(
            groups.laws.points.stiffness(self.b[t] + moved))
        least = ROUNDING * float(np.abs(self.q[t]).max(initial=0.0))
        enough = max(ENOUGH * self.rms[t], least) * np.sqrt(groups.members)
        self.question = question = Question(groups.laws, groups.group, groups.felt, before, anchor,
                                            number, start, self.q[t].copy(), enough)
        q, size = solved(question, groups.contact)
        told = groups.first >= 0
        self.unsolved[t, groups.first[told]] = (size > enough)[told]
        F = question.drawn(q)
        answer = groups.laws.force(F, before, number)
        self.q[t] = q = groups.laws.settled(answer.force, F, anchor)[0]
        # not (F − f̂)/keq: where q is near the answer only, jumps around a node of three bodies
        # would add up to something
        self.after = History(groups.laws.compliance(question.predicted(q) - q), answer.own)
        return F[:, : len(groups.chosen)], self.after.jump[:, : len(groups.chosen)]

    def shared(self, diagonal: np.ndarray,
               f_hat: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return traces of the groups (n,) int, and there forces f (T, n) and moves ŵ − w (T, n).

        A body feels the sum of its traces alone: f are the pairs' own f̂, and of what the node
        lacks a share by stiffness.

        diagonal : (D,) of k⁻; f_hat : (T, D) −Bᵀ f̂
        """
        groups, lacks = self.groups, self._lacks(self.q)
        stiff, at = groups.sums @ diagonal, groups.traces
        per = np.divide(1.0, stiff, out=np.zeros_like(stiff), where=stiff > 0)
        f = f_hat[:, at] + (times(groups.back, lacks * per) * diagonal)[:, at]
        return at, f, -times(groups.back, times(groups.C, lacks))[:, at]


def _met(groups: NodeGroups, pairs: Pairs, q: np.ndarray, before: History,
         anchors: np.ndarray | None) -> tuple[np.ndarray, History, np.ndarray | None]:
    """Forces q (T, 3, P), past, and anchors at the groups' points, other ranks' behind."""
    names = sorted({name for law in pairs.laws for name in law.variables})
    none, P = np.zeros(len(pairs)), len(pairs)
    own = np.array([before.own.get(name, none) for name in names]).reshape(len(names), P)
    parts = [q.reshape(3 * len(q), P), before.jump, own,
             *([] if anchors is None else [anchors.reshape(3 * len(q), P)])]
    here = [np.hstack([part[:, groups.chosen], far[:, groups.behind]])
            for part, far in zip(parts, groups.points(*parts))]
    q, jump, own = here[0].reshape(len(q), 3, -1), here[1], dict(zip(names, here[2]))
    return q, History(jump, own), None if anchors is None else here[3].reshape(len(q), 3, -1)
