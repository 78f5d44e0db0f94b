"""Stopping criterion where laws are not perfect: equilibrium and every law, see ``stopping.law_residuals``.

    law_residual ≤ tolerance.error     or     indicator η ≤ tolerance.indicator

With ``error: auto`` the energy residual counts as well,

    ε_K = max_t (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹)^½ / max_t ‖u‖_K.

It is in the units of the error because the laws are monotone (frictionless ones; Coulomb's where the statuses are
right): (f̂ − f*)·(ŵ − w*) ≤ 0 against the solution *, and ‖u − u*‖²_K = (f − f*)·(w − w*). With f − f̂ = k(w − ŵ)

    ‖u − u*‖²_K ≤ ‖f − f̂‖_k⁻¹ (‖w − w*‖_k + ‖f − f*‖_k⁻¹) ≤ c ‖f − f̂‖_k⁻¹ ‖u − u*‖_K,

c of order one for soles as stiff as the bodies behind them, which the defaults are. It is no guarantee.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.indicator import energy_residual
from orchestrator.method.stopping.law_residuals import Lengths, law_residuals


class LawCriterion(Monitor):
    """Equilibrium and the laws, or η. Where matter is nonlinear, the fixed point's residual too."""

    name = "law_residual"

    def __init__(self, case: Case):
        self.case, self.auto = case, case.method.tolerance.error == "auto"

    @classmethod
    def of(cls, case: Case) -> LawCriterion | None:
        return None if case.problem.all_perfect else cls(case)

    def judge(self, now: Evaluation) -> Verdict:
        problem, lengths, bound = now.problem, self.case.lengths(now.best.u), None
        laws = law_residuals([(problem.local.pairs, *now.best.extended, now.local, problem.local.before)], lengths, problem.space.team)
        if problem.nonlinear is not None:
            laws = laws.with_fixed_point(_fixed_point(now, lengths))
        value = laws.largest if self.case.by_error else now.measures.indicator
        if self.auto:
            bound = problem.bounded(now.best)
            value = max(value, energy_residual(problem.stage, now.best, now.local, problem.loading.size(bound.energy)))
        return Verdict(bool(value <= self.case.value), measure=value, bound=bound, laws=laws, lengths=lengths, told={
            "target": (self.name if self.case.by_error else "indicator", self.case.value), "law_residual": laws.largest,
            "laws": laws.measures})


def _fixed_point(now: Evaluation, lengths: Lengths) -> float:
    """‖F(s) − s‖ over ‖F(s)‖, or over a small share of k ℓ where the interfaces carry next to nothing."""
    k = now.problem.stage.direction.diagonal
    size = float(np.sqrt(np.sum(now.local.s**2 / k)))
    return now.measures.residual * size / (max(size, float(np.sqrt(k.sum())) * lengths.of_rest) or 1.0)
