"""When springs of stabilisation give way: where they alone keep a run from its end.

How much a spring carries is ε keq times how far the load step has moved its pair. Where a body goes far that may be slightly
more than the tolerance, though no law needs it, and it stays as much while iterations go on. Such springs then give way, like
viscous ones that yield: with the change d* − d*_before of the jumps at the time

    f̂ = (1 − ε) law(F) + ε (F − keq (d_before + δ)),   δ = (1 − min(1, q/q*)) (d* − d*_before),   q* = ε |keq (d* − d*_before)|/A

so that none carries more than q, a share of the tolerance, where pairs stand. Others stay as they are: bodies that have their
place by them would otherwise go far, and everything with them. It is done when

- they carry more than the tolerance, and at the pace of the last iteration would do so for another digit of the rest;
- nothing else is more than that digit above the tolerance, as giving way disturbs about as much; or the run would end as held
  by them;
- they carry no more than ``MOST`` tolerances, and above the tolerance at most half of what they did when they gave way last:
  what has no balance loads them as before wherever they begin, and the run then ends as held by them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation, Verdict
from orchestrator.method.monitors.monitor import Case, Monitor
from orchestrator.method.stopping.law_residuals import LawResiduals

# Of the tolerance, what springs that give way carry: the less is changed, the less is to be found anew. 125 grains at 1e-6, with ε
# a quarter of it, where they carry 1.07 tolerances, take 12 iterations from there on; 22 with a half; with none bodies go far,
# and all that they touch.
SHARE = 0.9
DIGIT = 10.0  # what is left when they give way, over the tolerance; and the iterations that take a digit from it
MOST = 100.0  # tolerances that they may carry: from there on they hold a load
LESS = 0.5  # of what they carried above the tolerance when they last gave way, below which that has served


class GivingWay(Monitor):
    """Lets springs of stabilisation give way where they alone keep the run from its end.

    Attributes
    ----------
    at : iterations after which they have given way
    """

    name = "giving_way"

    def __init__(self, value: Callable[[], float]):
        self.value = value
        self.yielded: tuple[np.ndarray, float] | None = None  # traces (T, D) where they have, and what they carried then at most
        self.at: list[int] = []
        self._above, self._before = math.nan, math.nan

    @classmethod
    def of(cls, case: Case) -> GivingWay | None:
        problem = case.problem
        if not case.by_error or problem.all_perfect or problem.coarse is None or problem.local.pairs.stabilisation is None:
            return None
        return cls(lambda: case.value)

    def judge(self, now: Evaluation) -> Verdict:
        if now.verdict.changes or not self.due(now.number, now.verdict.laws, self.value()):
            return Verdict()
        return Verdict(changes=(self.name,))

    def change(self, now: Evaluation) -> Decomposition:
        self.yielded = now.best.w, SHARE * self.value() * now.verdict.laws.traction
        self.at.append(now.number)
        return now.problem.yielding(*self.yielded)

    def found(self, problem: Decomposition) -> list[int]:
        return self.at

    def due(self, iteration: int, laws: LawResiduals, tolerance: float) -> bool:
        """Whether they are to give way after this iteration; all ranks see the same."""
        above, pace = laws.springs - tolerance, abs(laws.springs - self._before)
        self._before = laws.springs
        near = DIGIT * pace < above and laws.largest_other <= DIGIT * tolerance or laws.held_by_springs(tolerance)
        most = LESS * self._above if self.at else (MOST - 1) * tolerance
        if not (0 < above <= most and near):
            return False
        self._above = above
        return True

    def state(self) -> dict[str, Any]:
        told = {"at": list(self.at), "above": self._above, "before": self._before}
        return told if self.yielded is None else {**told, "trace/yielded": self.yielded[0], "most": self.yielded[1]}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.at, self._above, self._before = list(state["at"]), state["above"], state["before"]
        if "most" not in state:
            return problem
        self.yielded = state["trace/yielded"], state["most"]
        return problem.yielding(*self.yielded)
