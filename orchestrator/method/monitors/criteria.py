"""Stopping criteria: what iterations leave, and the tolerance ε that it has to fall below.

- bonded: the guaranteed bound E of ``stopping.bound``, E ≤ ε, or the paper's indicator η ≤ ε;
- elsewhere: equilibrium and every law, r ≤ ε, with the residuals r of ``stopping.law_residuals``,
  and where it is asked for the energy error E ≤ ε of the delivered fields, see
  ``stopping.certificate``.

With ``error: auto`` the tolerance follows an estimate η_h of the mesh's error: ε ≤ fraction · η_h,
estimated anew whenever what iterations leave has fallen to the level that the last estimate asked
for. On perfect interfaces, by Galerkin orthogonality, both errors are the legs of a right-angled
triangle, so that a fraction of 0.1 makes the whole error half a per cent larger. Elsewhere no right
angle is left: a fraction of 0.1 may cost up to a tenth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.bodies import body_residual, judged_together
from orchestrator.method.stopping.law_residuals import (FIXED_POINT, law_residuals, Lengths,
                                                        OF_BODIES)

LEAST = 1e-6  # what a tolerance that follows the mesh's error never goes below: the fixed default
BALANCED = 1e-12  # force imbalance that is nothing but rounding and foretells no bound


class Criterion(Monitor):
    """A stopping criterion.

    estimate : of the mesh's error, (problem, fields, bound) → relative, which the tolerance
        follows; None: it is as given
    error : the latest of these; nan before the first
    """

    def __init__(self, case: Case):
        self.case, self.error = case, math.nan
        self.estimate = case.given.get("estimate") if case.follows else None

    def measured(self, now: Evaluation) -> Verdict:
        """Return what is compared with the tolerance, and whether it is met."""
        raise NotImplementedError

    def judge(self, now: Evaluation) -> Verdict:
        verdict, case = self.measured(now), self.case
        if self.estimate is None:
            return verdict
        if verdict.met:
            # a back-substitution
            self.error = self.estimate(now.problem, now.best, verdict.bound)
            case.value = max(case.method.tolerance.fraction * self.error, LEAST)
            verdict = verdict.and_then(Verdict(bool(verdict.measure <= case.value), sweeps=1,
                                               target=(verdict.target[0], case.value)))
        return verdict.and_then(Verdict(told={"discretisation_error": self.error}))

    def state(self) -> dict[str, Any]:
        return super().state() | {"followed": [self.case.method.tolerance.fraction, self.error,
                                               self.case.value]}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        fraction, error, value = state["followed"]
        if self.estimate is not None and fraction == self.case.method.tolerance.fraction:
            self.error, self.case.value = error, value
        return super().restore(state, problem)


class BondedCriterion(Criterion):
    """The guaranteed error, or η; beside it the true error, where an undecomposed solution
    is there.
    """

    name, remembered = "error_bound", ("ratio",)

    def __init__(self, case: Case):
        super().__init__(case)
        self.ratio = 0.0

    @classmethod
    def of(cls, case: Case) -> BondedCriterion | None:
        return cls(case) if case.problem.all_perfect else None

    def measured(self, now: Evaluation) -> Verdict:
        name, bound = self.name, self._bound(now)
        measure = bound.relative
        if not self.case.by_error:
            name, measure = "indicator", now.measures.indicator
        told = {"error_bound": bound.relative}
        if true_error := self.case.given.get("true_error"):
            told["true_error"] = true_error(now.problem, now.best, bound)
        return Verdict(bool(measure <= self.case.value), measure=measure, bound=bound,
                       target=(name, self.case.value), sweeps=bound.sweeps, told=told)

    def _bound(self, now: Evaluation):
        """Return the bound, as far as it has to be known."""
        evaluate, value = now.problem.bound, self.case.value
        known = evaluate.first(now.best)
        bound, imbalance = known[0], now.measures.force_imbalance
        due = bound.a <= value and (imbalance <= BALANCED
                                    or self.ratio * imbalance <= _of_size(value))
        if self.case.by_error and due:
            bound = evaluate(now.best, value, known, value)
            least = bound.relative if np.isfinite(bound.relative) else bound.least
            self.ratio = _of_size(least) / imbalance if np.isfinite(
                least) and imbalance > 0 else 0.0
        return bound


def _of_size(relative: float) -> float:
    """An error relative to ‖u_exact‖ ≥ ‖u_D‖ − error, relative to ‖u_D‖: which falls with the
    forces' imbalance, as the other does
    not while it is large."""
    return relative / (1 + relative)


# law residual over the tolerance, from which E is worth knowing: E is half of it to ten times as
# much
NEAR = 2.0
LESS = 0.5  # of the residual at an earlier evaluation, below which E should have fallen
PATIENCE = 10  # iterations after which E is evaluated whatever the residual, and should have fallen
STALLED = 0.7  # of an earlier E, above which it stands still
# of the E at which springs were last asked to become weaker, above which it was not theirs
FALLS = 0.5
# law residual over the tolerance, and how often E stands still beside it, that end a run
SETTLED, MOST = 1e-2, 3
# law residual over the tolerance that ends a run whose error cannot be told: it is up to ten times
# the residual
LAWFUL = 0.1
STOPS = "error bound stands still"


class LawCriterion(Criterion):
    """Equilibrium and the laws, or η, where matter is nonlinear the fixed point's residual too;
    then the energy error, where it is asked for.

    certified : whether it is
    at, residual, energy_error : iteration, law residual and E of the last evaluation; before the
        first infinite, or those of the run whose state this one began with
    since : the same of the evaluation that E has to fall below
    asked : E when springs were last asked to become weaker
    waited : how often E stood still though laws hold well
    """

    name = "law_residual"
    remembered = ("at", "residual", "energy_error", "since", "asked", "waited")

    def __init__(self, case: Case):
        super().__init__(case)
        self.groups = judged_together(case.problem.scene, case.lengths)
        self.certified = case.problem.certificate is not None and case.by_error
        self.at, self.residual, self.energy_error, self.waited = 0, np.inf, np.inf, 0
        near = case.given.get("near", {}).get(self.name)
        if near and np.isfinite(near["energy_error"]):  # what E is beside the residual
            self.residual, self.energy_error = near["residual"], near["energy_error"]
        self.since, self.asked = (0, np.inf, np.inf), np.inf

    @classmethod
    def of(cls, case: Case) -> LawCriterion | None:
        return None if case.problem.all_perfect else cls(case)

    def measured(self, now: Evaluation) -> Verdict:
        verdict = self._lawful(now)
        return verdict.and_then(self._certified(now, verdict)) if self.certified else verdict

    def _lawful(self, now: Evaluation) -> Verdict:
        """Return how well equilibrium and laws hold."""
        problem, lengths = now.problem, self.case.lengths(now.best.u)
        parts = [(problem.local.pairs, *now.best.extended, now.local, problem.local.before)]
        laws = law_residuals(parts, lengths, problem.space.team)
        if problem.nonlinear is not None:
            laws = laws.and_also(FIXED_POINT, _fixed_point(now, lengths))
        if self.case.method.tolerance.law is not None:
            laws = laws.and_also(OF_BODIES,
                                 body_residual(parts, lengths.of_rest, problem.space,
                                               self.groups))
        value = laws.largest if self.case.by_error else now.measures.indicator
        name = self.name if self.case.by_error else "indicator"
        return Verdict(bool(value <= self.case.value), measure=value, laws=laws, lengths=lengths,
                       target=(name, self.case.value), told={"law_residual": laws.largest})

    def _certified(self, now: Evaluation, lawful: Verdict) -> Verdict:
        """Return the energy error, once it may be met."""
        value, residual = self.case.value, lawful.laws.largest_other
        target = "error_bound", value
        if not self.due(now.number, residual, value):
            return Verdict(False, target=target, told={"error_bound": np.nan})
        bound = now.problem.certificate(now.best, value)
        error = bound.relative if np.isfinite(bound.relative) else max(bound.a, bound.least)
        self.at, self.residual, self.energy_error = now.number, residual, error
        still, excess = self.stands_still() and error > value, 0.0
        if still and error <= FALLS * self.asked:
            self.asked, excess = error, float(error / max(value, residual))
        self.waited = self.waited + (still and residual <= SETTLED * value)
        formed = not bound.pair.missing  # where it cannot be, laws that hold well have to do
        met = bound.relative <= value if formed else lawful.laws.largest <= LAWFUL * value
        reason = STOPS if self.waited >= MOST and not met else ""
        return Verdict(bool(met), reason, measure=bound.relative, bound=bound, sweeps=bound.sweeps,
                       excess=excess, target=target, told={"error_bound": bound.relative})

    def due(self, number: int, residual: float, value: float) -> bool:
        """Whether E may be met in an iteration, taken to fall with the law residual."""
        if not residual <= NEAR * value:
            return False
        return (number >= self.at + PATIENCE or residual <= LESS * self.residual
                or residual * self.energy_error <= value * self.residual)

    def stands_still(self) -> bool:
        """Whether E has not fallen while the residual has halved, or in ``PATIENCE`` iterations."""
        at, residual, error = self.since
        now = self.at, self.residual, self.energy_error
        fallen = self.energy_error <= STALLED * error
        waited = self.residual <= LESS * residual or self.at >= at + PATIENCE
        if fallen or waited:
            self.since = now
        return waited and not fallen


def _fixed_point(now: Evaluation, lengths: Lengths) -> float:
    """‖F(s) − s‖ over ‖F(s)‖, or over a small share of k ℓ where the interfaces carry next to
    nothing.
    """
    k = now.problem.stage.direction.diagonal
    size = float(np.sqrt(np.sum(now.local.s**2 / k)))
    return now.measures.residual * size / (max(size, float(np.sqrt(k.sum())) * lengths.of_rest)
                                           or 1.0)
