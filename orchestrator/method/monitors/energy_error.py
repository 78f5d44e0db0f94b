"""Stopping criterion where interfaces are not perfect: the energy error E of the delivered fields, see ``stopping.certificate``.

    E ≤ tolerance.error

E costs about as much as an iteration. It is evaluated once the law residual is near the tolerance, and again when the residual has
fallen so far that E may be met: up to twice the tolerance E is found, so that this is known; above it the residual has to halve. Where E
stands still while the residual falls, springs that stay where they are are what is left of it: they are to become weaker
(``weakening``), unless that has not helped the last time. Where no admissible fields are found, a law residual of a tenth of the
tolerance has to do, and no error is told.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

NEAR = 2.0  # law residual over the tolerance, from which E is worth knowing: E is half of it to ten times as much
LESS = 0.5  # of the residual at an earlier evaluation, below which E should have fallen
PATIENCE = 10  # iterations after which E is evaluated whatever the residual, and should have fallen
STALLED = 0.7  # of an earlier E, above which it stands still
FALLS = 0.5  # of the E at which springs were last asked to become weaker, above which it was not theirs
SETTLED, MOST = 1e-2, 3  # law residual over the tolerance, and how often E stands still beside it, that end a run
LAWFUL = 0.1  # law residual over the tolerance that ends a run whose error cannot be told: it is up to ten times the residual
STOPS = "error bound stands still"


class EnergyErrorCriterion(Monitor):
    """The energy error.

    at, residual, error : iteration, law residual and E of the last evaluation; infinite before the first
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
        return Verdict(bool(met), reason, measure=bound.relative, bound=bound, sweeps=bound.sweeps, excess=excess,
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
