"""Stopping criteria: the error bound or the indicator where all is bonded, and the true error; the
energy error and the laws' residual elsewhere.

Where interfaces are not perfect the energy error is that of the delivered fields, see
``stopping.certificate``; equilibrium and every law have the residuals of
``stopping.law_residuals``. With ``error: auto`` the tolerance follows an estimate of the
discretisation error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.body_residual import body_residual, judged_together
from orchestrator.method.stopping.law_residuals import (FIXED_POINT, law_residuals, Lengths,
                                                        OF_BODIES)

BALANCED = 1e-12  # force imbalance that is nothing but rounding and foretells no bound


class ErrorBoundCriterion(Monitor):
    """The guaranteed error, or η."""

    name, remembered = "error_bound", ("ratio",)

    def __init__(self, case: Case):
        self.case, self.spare, self.ratio = case, case.method.skip.bound, 0.0

    @classmethod
    def of(cls, case: Case) -> ErrorBoundCriterion | None:
        return cls(case) if case.problem.all_perfect else None

    def judge(self, now: Evaluation) -> Verdict:
        evaluate, value = now.problem.bound, self.case.value
        known = evaluate.first(now.best)
        bound = known[0]
        if not self.case.by_error:
            eta = now.measures.indicator
            return self._verdict("indicator", eta, bound)
        imbalance = now.measures.force_imbalance
        due = bound.a <= value and (imbalance <= BALANCED
                                    or self.ratio * imbalance <= _of_size(value))
        if due or not self.spare:
            bound = evaluate(now.best, value if self.spare else np.inf, known, value)
            least = bound.relative if np.isfinite(bound.relative) else bound.least
            self.ratio = _of_size(least) / imbalance if np.isfinite(
                least) and imbalance > 0 else 0.0
        return self._verdict(self.name, bound.relative, bound)

    def _verdict(self, name: str, measure: float, bound) -> Verdict:
        return Verdict(bool(measure <= self.case.value), measure=measure, bound=bound,
                       sweeps=bound.sweeps,
                       told={"target": (name, self.case.value), "error_bound": bound.relative})


class TrueErrorMonitor(Monitor):
    """Tells what ``given["true_error"]``, (fields, bound) → relative energy error, says."""

    name = "true_error"

    def __init__(self, case: Case):
        self.case = case

    @classmethod
    def of(cls, case: Case) -> TrueErrorMonitor | None:
        return cls(case) if case.given.get("true_error") else None

    def judge(self, now: Evaluation) -> Verdict:
        return Verdict(
            told={"true_error": self.case.given["true_error"](now.best, now.verdict.bound)})


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


class EnergyErrorCriterion(Monitor):
    """The energy error.

    at, residual, error : iteration, law residual and E of the last evaluation; infinite before the
        first
    since : the same of the evaluation that E has to fall below
    asked : E when springs were last asked to become weaker
    waited : how often E stood still though laws hold well
    """

    name, remembered = "energy_error", ("at", "residual", "error", "since", "asked", "waited")

    def __init__(self, case: Case):
        self.case, self.at, self.residual, self.error, self.waited = case, 0, np.inf, np.inf, 0
        self.since, self.asked = (0, np.inf, np.inf), np.inf

    @classmethod
    def of(cls, case: Case) -> EnergyErrorCriterion | None:
        return cls(case) if case.problem.certificate is not None and case.by_error else None

    def judge(self, now: Evaluation) -> Verdict:
        value, residual = self.case.value, now.verdict.laws.largest_other
        told = {"target": ("error_bound", value)}
        if not self.due(now.number, residual, value):
            return Verdict(False, told={**told, "error_bound": np.nan})
        bound = now.problem.certificate(now.best, value)
        error = bound.relative if np.isfinite(bound.relative) else max(bound.a, bound.least)
        self.at, self.residual, self.error = now.number, residual, error
        still, excess = self.stands_still() and error > value, 0.0
        if still and error <= FALLS * self.asked:
            self.asked, excess = error, float(error / max(value, residual))
        self.waited = self.waited + (still and residual <= SETTLED * value)
        formed = not bound.pair.missing  # where it cannot be, laws that hold well have to do
        met = bound.relative <= value if formed else now.verdict.laws.largest <= LAWFUL * value
        reason = STOPS if self.waited >= MOST and not met else ""
        return Verdict(bool(met), reason, measure=bound.relative, bound=bound, sweeps=bound.sweeps,
                       excess=excess,
                       told={**told, "error_bound": bound.relative})

    def due(self, number: int, residual: float, value: float) -> bool:
        """Whether E may be met in an iteration, taken to fall with the law residual."""
        if not residual <= NEAR * value:
            return False
        return number >= self.at + PATIENCE or residual * self.error <= value * self.residual or residual <= LESS * self.residual

    def stands_still(self) -> bool:
        """Whether E has not fallen while the residual has halved, or in ``PATIENCE`` iterations."""
        at, residual, error = self.since
        now, fallen = (self.at, self.residual, self.error), self.error <= STALLED * error
        waited = self.residual <= LESS * residual or self.at >= at + PATIENCE
        if fallen or waited:
            self.since = now
        return waited and not fallen


class LawCriterion(Monitor):
    """Equilibrium and the laws, or η. Where matter is nonlinear, the fixed point's residual too."""

    name = "law_residual"

    def __init__(self, case: Case):
        self.case, self.groups = case, judged_together(case.problem.scene, case.lengths)

    @classmethod
    def of(cls, case: Case) -> LawCriterion | None:
        return None if case.problem.all_perfect else cls(case)

    def judge(self, now: Evaluation) -> Verdict:
        problem, lengths = now.problem, self.case.lengths(now.best.u)
        parts = [(problem.local.pairs, *now.best.extended, now.local, problem.local.before)]
        laws = law_residuals(parts, lengths, problem.space.team)
        if problem.nonlinear is not None:
            laws = laws.and_also(FIXED_POINT, _fixed_point(now, lengths))
        if self.case.method.tolerance.law is not None:
            laws = laws.and_also(OF_BODIES,
                                 body_residual(parts, lengths, problem.space, self.groups))
        value = laws.largest if self.case.by_error else now.measures.indicator
        return Verdict(bool(value <= self.case.value), measure=value, laws=laws, lengths=lengths,
                       told={
            "target": (self.name if self.case.by_error else "indicator", self.case.value),
            "law_residual": laws.largest,
            "laws": laws.measures})


def _fixed_point(now: Evaluation, lengths: Lengths) -> float:
    """‖F(s) − s‖ over ‖F(s)‖, or over a small share of k ℓ where the interfaces carry next to
    nothing.
    """
    k = now.problem.stage.direction.diagonal
    size = float(np.sqrt(np.sum(now.local.s**2 / k)))
    return now.measures.residual * size / (max(size, float(np.sqrt(k.sum())) * lengths.of_rest)
                                           or 1.0)


LEAST = 1e-6  # what the tolerance never goes below: the fixed default


class MeshError(Monitor):
    """The discretisation error as the last estimate has it: (problem, fields, bound) → relative,
    energy norm.

    ε ≤ fraction · η_h, η_h estimated anew whenever ε has fallen to the level that the last estimate
    asked for. On perfect interfaces ε is the bound. By Galerkin orthogonality both errors are the
    legs of a right-angled triangle, so that a fraction of 0.1 makes the whole error half a per cent
    larger. Elsewhere ε is the energy error, see ``energy_error``, and no right angle is left: a
    fraction of 0.1 may cost up to a tenth.
    """

    name = "mesh_error"

    def __init__(self, case: Case):
        self.case, self.fraction, self.error = case, case.method.tolerance.fraction, math.nan

    @classmethod
    def of(cls, case: Case) -> MeshError | None:
        return cls(
            case) if case.method.tolerance.error == "auto" and "estimate" in case.given else None

    def judge(self, now: Evaluation) -> Verdict:
        verdict = now.verdict
        if not verdict.met:
            return Verdict(told={"discretisation_error": self.error})
        # a back-substitution
        self.error = self.case.given["estimate"](now.problem, now.best, verdict.bound)
        self.case.value = max(self.fraction * self.error, LEAST)
        return Verdict(bool(verdict.measure <= self.case.value), sweeps=1, told={
            "discretisation_error": self.error,
            "target": (verdict.told["target"][0], self.case.value)})

    def state(self) -> dict[str, Any]:
        return {"value": self.case.value, "fraction": self.fraction, "error": self.error}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        if state["fraction"] == self.fraction:
            self.case.value, self.error = state["value"], state["error"]
        return problem
