"""Sides that slide on each other are paired anew where they are, within every load step until that moves no point any more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation, Verdict
from orchestrator.method.iterated import Paired
from orchestrator.method.monitors.monitor import Case, Monitor

# A residual of this share of how far points have moved since they were paired, in elements, is worth to pair them anew: what
# is solved better than that is solved for the wrong place.
WORTH = 0.1


class FollowingMonitor(Monitor):
    """Has the sides paired anew once points have slid farther than the tolerance, in elements, and the rest is solved as well."""

    name = "following"

    def __init__(self, case: Case):
        self.case, self.place = case, case.problem.following.place

    @classmethod
    def of(cls, case: Case) -> FollowingMonitor | None:
        return None if case.problem.following is None else cls(case)

    def judge(self, now: Evaluation) -> Verdict:
        moved = now.problem.following.moved(now.problem.local.pairs, now.best)
        if moved > self.case.value and now.verdict.measure <= max(self.case.value, WORTH * min(moved, 1.0)):
            return Verdict(False, changes=(self.name,), anew=True)
        return Verdict()

    def change(self, now: Evaluation) -> Decomposition:
        self.place = now.fields.w
        return now.problem.paired(self.place)

    def state(self) -> dict[str, Any]:
        return {"trace/place": self.place}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.place = state["trace/place"]
        return problem if np.array_equal(self.place, problem.following.place) else problem.paired(self.place)

    def found(self, problem: Decomposition) -> list[Paired]:
        return [Paired(problem.local.pairs, {i.index: i.mortar for i in problem.following.interfaces}, problem.local.before)]
