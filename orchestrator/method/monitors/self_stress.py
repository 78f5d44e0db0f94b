"""Where several interfaces that open meet at a node: when the rest is small, what is left may be self-stress, and is corrected.

The acceleration begins anew then, as an iteration answers otherwise from there on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from orchestrator.method.coarse.self_stress import RESTING
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict


class SelfStressMonitor(Monitor):
    """Lets the coarse contact problem correct self-stress from the iteration on whose law residual is small."""

    name, remembered = "self_stress", ("on",)

    @classmethod
    def of(cls, case: Case) -> SelfStressMonitor | None:
        return None if case.problem.self_stress is None else cls()

    def judge(self, now: Evaluation) -> Verdict:
        self.on = now.problem.at_nodes
        resting = not self.on and now.verdict.laws.largest_other <= RESTING
        return Verdict(changes=(self.name,), anew=True) if resting else Verdict()

    def change(self, now: Evaluation) -> Decomposition:
        return self.restore({"on": True}, now.problem)

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        super().restore(state, problem)
        return replace(problem, at_nodes=self.on)
