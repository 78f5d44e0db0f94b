"""Groups of a few points that are all in contact: their matrices lie side by side, and
``node_loops`` answers them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import in_parts
from orchestrator.method.interface.answering import LawPoints
from orchestrator.method.interface.rows import bounds_of

FEW = 40  # points of a group, beyond which a sparse matrix is worth more than a compiled loop
WORTH = 1 << 8  # groups, which take several times as long as to hand them out to a thread


@dataclass(frozen=True)
class ContactGroups:
    """Of n groups those that are.

    quick : (n,) bool
    order : (Q,) int, their points, group after group
    bounds : (k + 1,) int, where those of each begin
    places : (k,) int, where the matrix 1 − keq S of each begins in matrices (·,), component after
        component
    """

    quick: np.ndarray
    order: np.ndarray
    bounds: np.ndarray
    places: np.ndarray
    matrices: np.ndarray

    @classmethod
    def of(cls, laws: LawPoints, group: np.ndarray, felt: sp.csr_array) -> ContactGroups:
        """Return those of all points, group (R,) int and felt (3R, 3R) as ``NodeGroups`` has
        them.
        """
        contact, R = np.zeros(len(group), bool), len(group)
        for run in laws.runs:
            # a law made of contact may answer otherwise
            contact[run.part] = run.law.perfect or run.law.force is run.law.loops
        members = np.bincount(group)
        quick = (np.bincount(group, ~contact) == 0) & (members <= FEW)
        order = np.argsort(group, kind="stable")
        order = order[quick[group[order]]]
        members = members[quick]
        bounds, starts = bounds_of(members), bounds_of((3 * members) ** 2)
        place, number = np.zeros(R, int), np.cumsum(quick) - 1
        place[order] = np.arange(len(order)) - np.repeat(bounds[:-1], members)
        entries = felt.tocoo()
        i, j = (x.astype(int) for x in entries.coords)
        here = quick[group[i % R]]
        (c, p), (d, q), which = np.divmod(i[here],
                                          R), np.divmod(j[here], R), number[group[i[here] % R]]
        m, places = members[which], starts[:-1]
        matrices = np.zeros(starts[-1])
        matrices[places[which] + (c * m + place[p]) * 3 * m + d * m + place[q]] = entries.data[here]
        return cls(quick, order, bounds, places, matrices)

    def answered(self, question, pulls: tuple, rounds: int,
                 lengths: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Return forces (3, Q) of these points and what is left of ‖r‖ (k,).

        question : a ``node_newton.Question``; the others : as the loops take them
        """
        from orchestrator.method.interface.node_loops import answered

        at, laws = self.order, question.laws
        each = [run.points.at(question.number) for run in laws.runs]
        gap, friction = (np.concatenate([p.own.get(name, np.zeros(len(p))) for p in each])[at]
                         for name in ("gap", "friction"))
        springs = np.zeros(len(laws)) if laws.stabilisation is None else laws.stabilisation.copy()
        rest = laws.points.stiffness(question.anchor)
        for run in laws.runs:  # bonds are nothing but springs
            if run.law.perfect:
                springs[run.part], rest[:, run.part] = 1.0, 0.0
        springs = springs[at]
        points = (*(np.ascontiguousarray(x[..., at]) for x in laws.points.search), gap, friction)
        given = points, *(np.ascontiguousarray(x[:, at]) for x in (
            question.start, question.before.jump, rest, question.known)), springs, \
            np.ascontiguousarray(laws.free[:, at])
        q, size = np.empty((3, len(at))), np.empty(len(self.places))
        in_parts(answered, len(size), (self.bounds, self.places, self.matrices), given,
                 question.enough[self.quick], (np.array(pulls), rounds, *lengths), q, size,
                 part=max(WORTH, len(size) // 4 + 1))
        return q, size
