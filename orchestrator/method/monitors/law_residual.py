"""Stopping criterion where laws are not perfect: equilibrium and every law, see ``stopping.law_residuals``.

    law_residual ≤ tolerance.law     or     indicator η ≤ tolerance.indicator

With ``tolerance: {error: …}`` it decides where no energy error is known, as beside nonlinear matter; elsewhere ``energy_error`` does.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.body_residual import body_residual, judged_together
from orchestrator.method.stopping.law_residuals import FIXED_POINT, OF_BODIES, Lengths, law_residuals


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
            laws = laws.and_also(OF_BODIES, body_residual(parts, lengths, problem.space, self.groups))
        value = laws.largest if self.case.by_error else now.measures.indicator
        return Verdict(bool(value <= self.case.value), measure=value, laws=laws, lengths=lengths, told={
            "target": (self.name if self.case.by_error else "indicator", self.case.value), "law_residual": laws.largest,
            "laws": laws.measures})


def _fixed_point(now: Evaluation, lengths: Lengths) -> float:
    """‖F(s) − s‖ over ‖F(s)‖, or over a small share of k ℓ where the interfaces carry next to nothing."""
    k = now.problem.stage.direction.diagonal
    size = float(np.sqrt(np.sum(now.local.s**2 / k)))
    return now.measures.residual * size / (max(size, float(np.sqrt(k.sum())) * lengths.of_rest) or 1.0)
