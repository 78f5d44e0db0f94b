"""Newton's method for laws that are answered together, group by group.

    r(q) = q − law(F) = 0,    F = q + keq (b − S q) + τ (q₀ − q),    J = 1 − A (1 − keq S − τ)

with A = ∂law/∂F, and q₀ the forces that were there before: a proximal step. Where pairs form a
circle forces may run around it that no body feels, but limits of friction do. Without τ the answer
then jumps to another one, far away, at the least change of b, and back again; with it forces move
steadily, and where they rest, q = q₀, the laws hold to the letter. Where Newton's method does not
get there, a larger τ takes a shorter step.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.interface.answering import History, LawPoints
from orchestrator.method.interface.node_contact import ContactGroups
from orchestrator.method.interface.node_groups import pointwise
from orchestrator.method.interface.rows import rows_of

LENGTHS = (1.0, 0.4, 0.16, 0.06)  # of a step, tried in turn
LESS = 0.05  # of what is left, times the length: what a step has to save
ROUNDS = 12  # steps
# τ, tried in turn. Iterations are the same from 1e-4 to 1e-3; at 5e-3 forces move too slowly
PULLS = (1e-3, 1e-2, 1e-1, 1.0)


@dataclass(frozen=True)
class Question:
    """Question that groups are asked at a load step.

    laws : what R points answer; group : (R,) int, of n groups, which is each point's
    felt : (3R, 3R) 1 − keq S, component after component
    before : what the load step before has left
    anchor : (3, R) jumps at which springs of stabilisation carry nothing
    number : of the load step
    start : (3, R) keq b
    known : (3, R) q₀
    pull : τ
    enough : (n,) what may be left of ‖r‖ in each
    """

    laws: LawPoints
    group: np.ndarray
    felt: sp.csr_array
    before: History
    anchor: np.ndarray
    number: int
    start: np.ndarray
    known: np.ndarray
    enough: np.ndarray
    pull: float = PULLS[0]

    def some(self, wanted: np.ndarray) -> tuple[np.ndarray, Question]:
        """Return the points (Q,) int of some of the groups (n,) bool, and what these are asked."""
        at = np.flatnonzero(wanted[self.group])
        dofs = rows_of(at, len(self.group))
        return at, Question(self.laws.alone(at), (np.cumsum(wanted) - 1)[self.group[at]],
                            sp.csr_array(self.felt[dofs][:, dofs]), self.before.take(at),
                            self.anchor[:, at],
                            self.number, self.start[:, at], self.known[:, at],
                            self.enough[wanted], self.pull)

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """Return (3, R) q + keq (b − S q)."""
        return self.start + (self.felt @ q.ravel()).reshape(q.shape)

    def drawn(self, q: np.ndarray) -> np.ndarray:
        """Return (3, R) F, what the laws are asked."""
        return self.predicted(q) + self.pull * (self.known - q)

    def left(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return r (3, R), A (3, 3, R) and ‖r‖ (n,)."""
        laws, F = self.laws, self.drawn(q)
        answer = laws.force(F, self.before, self.number, derivative=True)
        slope = laws.slopes(answer, 0.0 if laws.stabilisation is None else laws.stabilisation)
        r = q - laws.settled(answer.force, F, self.anchor)[0]
        return r, slope, self.size(r)

    def size(self, r: np.ndarray) -> np.ndarray:
        """Return (n,) ‖r‖ of each group."""
        return np.sqrt(np.bincount(self.group, (r**2).sum(axis=0), len(self.enough)))

    def steps(self, r: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return (3, R) J⁻¹ r."""
        felt = self.felt - self.pull * sp.eye_array(r.size)
        J = sp.eye_array(r.size) - pointwise(slope) @ felt
        with suppress(RuntimeError):  # exactly singular: no step
            return sla.splu(sp.csc_array(J)).solve(r.ravel()).reshape(r.shape)
        return np.zeros_like(r)


def solved(question: Question, contact: ContactGroups) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (3, R) that obey the laws, from those known on, and what is left of ‖r‖
    (n,).
    """
    q, size = question.known.copy(), np.full(len(question.enough), np.inf)
    if len(contact.order):
        q[:, contact.order], size[contact.quick] = contact.answered(question, PULLS, ROUNDS,
                                                                    (np.array(LENGTHS), LESS))
    for pull in PULLS:  # of groups that no loop answers
        open_ = ~contact.quick & (size > question.enough)
        if not open_.any():
            break
        at, few = question.some(open_)
        q[:, at], size[open_] = _newton(replace(few, pull=pull))
    return q, size


def _newton(question: Question) -> tuple[np.ndarray, np.ndarray]:
    """Forces and what is left, by Newton's method with one τ."""
    q, moves = question.known.copy(), np.ones(len(question.enough), bool)
    r, slope, size = question.left(q)
    for _ in range(ROUNDS):
        open_ = moves & (size > question.enough)
        if not open_.any():
            break
        at, few = question.some(open_)
        step, moves = few.steps(r[:, at], slope[:, :, at]), moves & ~open_
        for length in LENGTHS:  # of the groups that are left
            trial = q[:, at] - length * step
            found = few.left(trial)
            good = found[2] < (1 - LESS * length) * size[open_]
            moved, groups = good[few.group], np.flatnonzero(open_)
            for known, new in zip((q, r, slope), (trial, *found)):
                known[..., at[moved]] = new[..., moved]
            size[groups[good]], moves[groups[good]] = found[2][good], True
            open_[groups[good]] = False
            if good.all():
                break
            left, few = few.some(~good)
            at, step = at[left], step[:, left]
    return q, size
