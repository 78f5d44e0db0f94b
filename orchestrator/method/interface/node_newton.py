"""Newton's method for laws that are answered together, group by group.

    r(q) = q − law(q + keq (b − S q)) = 0,    J = 1 − (1 − δ) A (1 − keq S),    A = ∂law/∂F

Where friction folds the branch away that the forces came from, no step lowers ‖r‖: r stays nearly
as it is wherever forces go along it. There Newton's method begins anew from places along r, each
twice as far as the one before. Where none leads to an answer bodies are wedged around a node: all
stick, and the jumps at which they do so do not add up to nothing. Then no forces obey the laws, and
those that are nearest are taken.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.method.interface.answering import History, LawPoints
from orchestrator.method.interface.node_contact import ContactGroups
from orchestrator.method.interface.node_groups import pointwise
from orchestrator.method.interface.rows import rows_of

LENGTHS = (1.0, 0.4, 0.16, 0.06)  # of a step, tried in turn
LESS = 0.05  # of what is left, times the length: what a step has to save
# Shifts δ, tried in turn where a step saves nothing: with friction J may be singular on the way.
SHIFTS = np.array([1e-6, 1e-3, 3e-2, 3e-1])
ROUNDS = 12  # steps
REPEATS = 50  # places along r: the last is as far as forces are beyond their last digit


@dataclass(frozen=True)
class Question:
    """Question that groups are asked at a load step.

    laws : what R points answer; group : (R,) int, of n groups, which is each point's
    felt : (3R, 3R) 1 − keq S, component after component
    before : what the load step before has left
    anchor : (3, R) jumps at which springs of stabilisation carry nothing
    number : of the load step
    start : (3, R) keq b
    enough : (n,) what may be left of ‖r‖ in each
    """

    laws: LawPoints
    group: np.ndarray
    felt: sp.csr_array
    before: History
    anchor: np.ndarray
    number: int
    start: np.ndarray
    enough: np.ndarray

    def some(self, wanted: np.ndarray) -> tuple[np.ndarray, Question]:
        """Return the points (Q,) int of some of the groups (n,) bool, and what these are asked."""
        at = np.flatnonzero(wanted[self.group])
        dofs = rows_of(at, len(self.group))
        return at, Question(self.laws.alone(at), (np.cumsum(wanted) - 1)[self.group[at]],
                            sp.csr_array(self.felt[dofs][:, dofs]), self.before.take(at),
                            self.anchor[:, at],
                            self.number, self.start[:, at], self.enough[wanted])

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """Return (3, R) F = q + keq (b − S q)."""
        return self.start + (self.felt @ q.ravel()).reshape(q.shape)

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Return r (3, R)."""
        F = self.predicted(q)
        answer = self.laws.force(F, self.before, self.number)
        return q - self.laws.settled(answer.force, F, self.anchor)[0]

    def left(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return r (3, R), A (3, 3, R) and ‖r‖ (n,)."""
        laws, F = self.laws, self.predicted(q)
        answer = laws.force(F, self.before, self.number, derivative=True)
        slope = laws.slopes(answer, 0.0 if laws.stabilisation is None else laws.stabilisation)
        r = q - laws.settled(answer.force, F, self.anchor)[0]
        return r, slope, self.size(r)

    def size(self, r: np.ndarray) -> np.ndarray:
        """Return (n,) ‖r‖ of each group."""
        return np.sqrt(np.bincount(self.group, (r**2).sum(axis=0), len(self.enough)))

    def steps(self, r: np.ndarray, slope: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Return (3, R) J⁻¹ r, with shifts δ (n,)."""
        J = sp.eye_array(r.size) - pointwise((1 - shift[self.group]) * slope) @ self.felt
        with suppress(RuntimeError):  # exactly singular: no step, and another shift
            return sla.splu(sp.csc_array(J)).solve(r.ravel()).reshape(r.shape)
        return np.zeros_like(r)


def solved(question: Question, q: np.ndarray,
           contact: ContactGroups) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (3, R) that obey the laws, from those given on, and what is left of ‖r‖
    (n,).
    """
    q, size = q.copy(), np.empty(len(question.enough))
    if len(contact.order):
        effort, tries = (SHIFTS, np.array(LENGTHS), LESS), (ROUNDS, REPEATS)
        q[:, contact.order], size[contact.quick] = contact.answered(question, q, effort, tries)
    others = ~contact.quick
    if others.any():
        at, few = question.some(others)
        q[:, at], size[others] = _others(few, q[:, at])
    return q, size


def _others(question: Question, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of groups that no loop answers."""
    q, size = _newton(question, q)
    stuck = q.copy()
    for number in range(REPEATS):
        open_ = size > question.enough
        if not open_.any():
            break
        at, few = question.some(open_)
        here = stuck[:, at]
        found, left = _newton(few, here - 2.0**number * few.residual(here))
        better = (left < size[open_])[few.group]
        q[:, at[better]] = found[:, better]
        size[open_] = np.minimum(left, size[open_])
    return q, size


def _newton(question: Question, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and what is left, by Newton's method alone."""
    q, failures = q.copy(), np.zeros(len(question.enough), int)
    r, slope, size = question.left(q)
    for _ in range(ROUNDS):
        open_ = size > question.enough
        if not open_.any():
            break
        at, few = question.some(open_)
        step = few.steps(r[:, at], slope[:, :, at], SHIFTS[failures[open_] % len(SHIFTS)])
        failures[open_] += 1
        for length in LENGTHS:  # of the groups that are left
            trial = q[:, at] - length * step
            found = few.left(trial)
            good = found[2] < (1 - LESS * length) * size[open_]
            moved, groups = good[few.group], np.flatnonzero(open_)
            for known, new in zip((q, r, slope), (trial, *found)):
                known[..., at[moved]] = new[..., moved]
            size[groups[good]], failures[groups[good]] = found[2][good], 0
            open_[groups[good]] = False
            if good.all():
                break
            left, few = few.some(~good)
            at, step = at[left], step[:, left]
    return q, size
