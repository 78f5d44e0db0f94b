"""Stopping criterion where interfaces are not perfect: the energy error E of the delivered fields, see ``stopping.certificate``.

    E ≤ tolerance.error

E costs about as much as an iteration. It is evaluated once the law residual is near the tolerance, and again when the residual has
fallen so far that E may be met. Where E stands still while the residual falls, springs of stabilisation are what is left of it: they
are to become weaker. Where no admissible fields are found, the law residual decides, and no error is told. It decides as well where bodies are loose: 64 grains whose
laws hold to 1e-7 have a bound of 1e-2, since places that next to nothing determines count; there the bound is told at the end alone.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

NEAR = 2.0  # law residual over the tolerance, from which E is worth knowing: E is half of it to six times as much
LESS = 0.5  # of the residual at the last evaluation, below which E is evaluated again, whatever it was
SETTLED, MOST = 1e-2, 3  # law residual over the tolerance, and evaluations in which E stands still beside it, that end a run
STOPS = "error bound stands still"
PATIENCE = 10  # iterations after which it is in any case
STALLED = 0.7  # of the E before, above which it stands still, if the residual has halved or stands still, too


class EnergyErrorCriterion(Monitor):
    """The energy error.

    at, residual, error : iteration, law residual and E of the last evaluation; infinite before the first
    waited : evaluations in a row in which E stood still though laws hold well
    """

    name, remembered = "energy_error", ("at", "residual", "error", "waited")

    def __init__(self, case: Case):
        self.case, self.at, self.residual, self.error, self.waited = case, 0, np.inf, np.inf, 0

    @classmethod
    def of(cls, case: Case) -> EnergyErrorCriterion | None:
        problem = case.problem
        loose = not problem.all_perfect and problem.local.pairs.stabilisation is not None  # on all ranks, or on none
        return cls(case) if problem.certificate is not None and case.by_error and not loose else None

    def judge(self, now: Evaluation) -> Verdict:
        value, residual = self.case.value, now.verdict.laws.largest_other
        told = {"target": ("error_bound", value)}
        if not self.due(now.number, residual, value):
            return Verdict(False, told={**told, "error_bound": np.nan})
        bound = now.problem.certificate(now.best, value)
        error = bound.relative if np.isfinite(bound.relative) else max(bound.a, bound.least)
        settled = residual <= LESS * self.residual or now.number >= self.at + PATIENCE > PATIENCE
        self.waited = self.waited + 1 if residual <= SETTLED * value and error > STALLED * self.error else 0
        stalls = bool(error > value and settled and error > STALLED * self.error)
        self.at, self.residual, self.error = now.number, residual, error
        share = now.problem.steps / now.problem.scene.steps
        formed = not (bound.unbalanced.any() or bound.broken.any())  # where it cannot be, laws that hold have to do
        met = bound.relative <= value if formed else now.verdict.laws.largest <= value
        reason = STOPS if self.waited >= MOST and not met else ""
        return Verdict(bool(met), reason, measure=bound.relative, bound=bound, sweeps=bound.sweeps * share, stalls=stalls,
                       told={**told, "error_bound": bound.relative})

    def due(self, number: int, residual: float, value: float) -> bool:
        """Whether E may be met in an iteration, taken to fall with the law residual."""
        if not residual <= NEAR * value:
            return False
        return number >= self.at + PATIENCE or residual * self.error <= value * self.residual or residual <= LESS * self.residual
