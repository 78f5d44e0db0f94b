"""The error where all is bonded: the Prager–Synge bound of ``stopping.bound``, or the paper's η for its studies, as criterion; and the
true error, where the exact solution is known.

    error_bound ≤ tolerance.error     or     indicator η ≤ tolerance.indicator

The bound's second part costs back-substitutions. It is evaluated once the first part is below the tolerance, and again when
the force imbalance has fallen enough to make a difference.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

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
        due = bound.a <= value and (imbalance <= BALANCED or self.ratio * imbalance <= _of_size(value))
        if due or not self.spare:
            bound = evaluate(now.best, value if self.spare else np.inf, known, value)
            least = bound.relative if np.isfinite(bound.relative) else bound.least
            self.ratio = _of_size(least) / imbalance if np.isfinite(least) and imbalance > 0 else 0.0
        return self._verdict(self.name, bound.relative, bound)

    def _verdict(self, name: str, measure: float, bound) -> Verdict:
        return Verdict(bool(measure <= self.case.value), measure=measure, bound=bound, sweeps=bound.sweeps,
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
        return Verdict(told={"true_error": self.case.given["true_error"](now.best, now.verdict.bound)})


def _of_size(relative: float) -> float:
    """An error relative to ‖u_exact‖ ≥ ‖u_D‖ − error, relative to ‖u_D‖: which falls with the forces' imbalance, as the other does
    not while it is large."""
    return relative / (1 + relative)
