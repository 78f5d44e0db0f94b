"""The true error of what would be delivered, where the exact solution is known; it is asked after every iteration."""

from __future__ import annotations

from orchestrator.method.evaluation import Evaluation, Verdict
from orchestrator.method.monitors.monitor import Case, Monitor


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
