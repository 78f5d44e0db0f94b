"""Newton's method for laws that are answered together, group by group.

    r(q) = q − law(q + keq (b − S q)) = 0,    J = 1 − (1 − δ) A (1 − keq S),    A = ∂law/∂F

Where friction folds the branch away that the forces came from, no step lowers ‖r‖. There the limits
of friction are those of the last answer, which makes the laws convex, and are renewed until they
stay (Haslinger, Math. Methods Appl. Sci. 5, 1983). They never stay where bodies around a node are
wedged: all stick, and the jumps at which they do so do not add up to nothing. Then no forces obey
the laws, and those that are nearest are taken.
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

LENGTHS = (0.4, 0.16, 0.06)  # of a step, tried in turn after all of it
LESS = 0.05  # of what is left, times the length: what a step has to save
# Shifts δ, tried in turn where a step saves nothing: with friction J may be singular on the way.
SHIFTS = np.array([1e-6, 1e-3, 3e-2, 3e-1])
ROUNDS = 12  # steps
REPEATS, PATIENCE = 60, 6  # of renewed limits of friction; of these, in a row, that save nothing


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

    def answer(self, F: np.ndarray) -> np.ndarray:
        """Return (3, R) what the laws answer, with springs of stabilisation."""
        answer = self.laws.force(F, self.before, self.number)
        return self.laws.settled(answer.force, F, self.anchor)[0]

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

    def steps(self, r: np.ndarray, slope: np.ndarray, open_: np.ndarray,
              shift: np.ndarray) -> np.ndarray:
        """Return (3, R) J⁻¹ r of groups that are open (n,) bool, with shifts δ (n,); 0
        elsewhere.
        """
        at, result = np.flatnonzero(open_[self.group]), np.zeros_like(r)
        dofs = rows_of(at, len(self.group))
        weight = (1 - shift[self.group[at]]) * slope[:, :, at]
        J = sp.eye_array(len(dofs)) - pointwise(weight) @ self.felt[dofs][:, dofs]
        with suppress(RuntimeError):  # exactly singular: no step, and another shift
            result[:, at] = sla.splu(sp.csc_array(J)).solve(r[:, at].ravel()).reshape(3, -1)
        return result


def solved(question: Question, q: np.ndarray,
           contact: ContactGroups) -> tuple[np.ndarray, np.ndarray]:
    """Return forces (3, R) that obey the laws, from those given on, and what is left of ‖r‖
    (n,).
    """
    q, size = q.copy(), np.empty(len(question.enough))
    if len(contact.order):
        effort = SHIFTS, np.array([1.0, *LENGTHS]), LESS
        q[:,
          contact.order], size[contact.quick] = contact.answered(
              question, q, effort, (ROUNDS, REPEATS, PATIENCE))
    if len(contact.order) < q.shape[1]:
        at, few = question.some(~contact.quick)
        q[:, at], size[~contact.quick] = _newton(few, q[:, at])
        open_ = ~contact.quick & (size > question.enough)
        if open_.any():
            at, few = question.some(open_)
            q[:, at], size[open_] = _renewed(few, q[:, at])
    return q, size


class _Best:
    """The best forces so far, and the groups that are still looked at.

    q, size : (3, R), (n,) of all groups
    question : of those looked at; points, groups : which they are
    """

    def __init__(self, question: Question, q: np.ndarray, size: np.ndarray):
        self.question, self.q, self.size = question, q.copy(), size.copy()
        self.points, self.groups = np.arange(q.shape[1]), np.arange(len(size))

    def take(self, q: np.ndarray, size: np.ndarray) -> None:
        """Keep what is better."""
        better = size < self.size[self.groups]
        moved = better[self.question.group]
        self.q[:, self.points[moved]] = q[:, moved]
        self.size[self.groups[better]] = size[better]

    def narrow(self, open_: np.ndarray) -> np.ndarray:
        """Look at some of the groups only; returns which of the points (Q,) int these have."""
        at, self.question = self.question.some(open_)
        self.points, self.groups = self.points[at], self.groups[open_]
        return at


def _newton(question: Question, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and what is left, by Newton's method alone."""
    r, slope, size = question.left(q)
    best, failures = _Best(question, q, size), np.zeros(len(size), int)
    for _ in range(ROUNDS):
        open_ = size > question.enough
        if not open_.any():
            break
        if 2 * np.count_nonzero(open_[question.group]) < q.shape[1]:
            at = best.narrow(open_)
            question, q, r, slope = best.question, q[:, at], r[:, at], slope[:, :, at]
            size, failures, open_ = size[open_], failures[open_], np.ones(len(best.groups), bool)
        step = question.steps(r, slope, open_, SHIFTS[failures % len(SHIFTS)])
        q, r, slope, saved = _searched(question, q, (r, slope, size), step, open_)
        size = question.size(r)
        failures = np.where(saved, 0, failures + 1)
        best.take(q, size)
    return best.q, best.size


def _searched(question: Question, q: np.ndarray, known: tuple[np.ndarray, ...], step: np.ndarray,
              open_: np.ndarray) -> tuple[np.ndarray, ...]:
    """Forces along the steps as far as they save something, r and A there, and the groups (bool)
    whose do.
    """
    r, slope, size = known
    trial = q - step
    found = question.left(trial)
    waiting = open_ & (found[2] >= (1 - LESS) * size)
    moved = (open_ & ~waiting)[question.group]
    q, r, slope = np.where(moved, trial, q), np.where(moved, found[0],
                                                      r), np.where(moved, found[1], slope)
    for length in LENGTHS if waiting.any() else ():
        at, few = question.some(waiting)
        trial = q[:, at] - length * step[:, at]
        found = few.left(trial)
        good = found[2] < (1 - LESS * length) * size[waiting]
        moved = good[few.group]
        q[:, at[moved]], r[:, at[moved]], slope[:, :, at[moved]] = (
            trial[:, moved], found[0][:, moved], found[1][:, :, moved])
        waiting[waiting] = ~good
        if not waiting.any():
            break
    return q, r, slope, open_ & ~waiting


def _renewed(question: Question, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces and what is left, by limits of friction that are those of the answer before."""
    force = question.answer(question.predicted(q))
    size = question.size(q - force)
    best, waited = _Best(question, q, size), np.zeros(len(size), int)
    for _ in range(REPEATS):
        open_ = (size > question.enough) & (waited < PATIENCE)
        if not open_.any():
            break
        if not open_.all():
            at = best.narrow(open_)
            question, q, force, waited = best.question, q[:, at], force[:, at], waited[open_]
        convex = replace(question, laws=question.laws.lagged(force), enough=0.1 * question.enough)
        q, _ = _newton(convex, q)
        force = question.answer(question.predicted(q))
        size = question.size(q - force)
        waited = np.where(size < best.size[best.groups], 0, waited + 1)
        best.take(q, size)
    return best.q, best.size
