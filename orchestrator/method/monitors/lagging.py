"""Points that lag behind: where a run becomes slow near its end, and a few points carry what is left, these are solved exactly.

A few points may keep a run from its end: four grains that meet at a node and hold each other by much friction, a grain that touches
its neighbours at three. There an iteration contracts hardly or goes round in statuses, the acceleration has no direction for
them, and all others wait. So they are eliminated: their traces become fields of the coarse contact problem, which then solves their
laws as they are, together with how bodies move (nonlinear elimination: Cai & Li, SIAM J. Sci. Comput. 33, 2011).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.method.coarse.self_stress import RESTING
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

PATIENCE, FALLS = 8, 0.1  # iterations in which ‖F(s) − s‖ falls to such a share where a run is not slow
# Of the square of what is left in all load steps, what a point carries that lags behind; and how often twice that is tried where there
# is no room for so many.
SHARE, FEWER = 0.01, 7


class LaggingPoints(Monitor):
    """Gives points that lag behind fields of their own.

    mark : iteration and residual that a later one is compared with
    resting : whether the law residual has been small
    chosen, afresh : (q,) int, trace dofs that are to become fields of their own; those before give way
    since : (1, D) iteration after which each trace dof of this rank became a field of its own; 0: it is none
    """

    name = "lagging"

    def __init__(self, space: TraceSpace):
        self.mark, self.since, self.resting = (0, 1.0), np.zeros((1, space.size)), False
        self.chosen, self.afresh = np.empty(0, dtype=int), False

    @classmethod
    def of(cls, case: Case) -> LaggingPoints | None:
        """Where points are pairs of nodes."""
        problem = case.problem
        if problem.all_perfect or problem.coarse is None or not problem.local.pairs.transfer.picks:
            return None
        return cls(problem.space)

    def judge(self, now: Evaluation) -> Verdict:
        residual = now.measures.residual
        self.resting = bool(self.resting or now.verdict.laws.largest_other <= RESTING)
        if now.last or now.verdict.reason or not self.resting or now.number < self.mark[0] + PATIENCE:
            return Verdict()
        slow, self.mark = residual > FALLS * self.mark[1], (now.number, float(residual))
        if not slow:
            return Verdict()
        self.chosen, self.afresh = self.fitting(now)
        most = now.problem.coarse.most(self.chosen)
        return Verdict(changes=(self.name,), sweeps=most / now.problem.steps) if most else Verdict()

    def fitting(self, now: Evaluation) -> tuple[np.ndarray, bool]:
        """Trace dofs of this rank, the farthest behind, that the coarse problem has room for; and whether those before give way, as they
        do where there is room for none beside them."""
        coarse, left = now.problem.coarse, lags(now)
        behind = [traces_of(now, left > SHARE * 2**k) for k in range(FEWER)]
        new = [dofs[self.since[0, dofs] == 0] for dofs in behind]
        if coarse.most(new[0]):
            for fields, several in ((coarse.response, new), (coarse.usual, behind)):
                for chosen in several:
                    if (more := coarse.most(chosen)) and coarse.has_room(fields, more):
                        return chosen, fields is not coarse.response
        return new[0][:0], False

    def change(self, now: Evaluation) -> Decomposition:
        coarse = now.problem.coarse
        if self.afresh:
            coarse, self.since = coarse.without_own(), np.zeros_like(self.since)
        self.since[0, self.chosen] = now.number
        return replace(now.problem, coarse=coarse.with_own(self.chosen))

    def state(self) -> dict[str, Any]:
        return {"trace/since": self.since.copy(), "mark": list(self.mark), "resting": self.resting}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.since, self.mark, self.resting = state["trace/since"].copy(), tuple(state["mark"]), state["resting"]
        coarse = problem.coarse
        for number in sorted(set().union(*problem.space.team.all_gather(self.since[self.since > 0].tolist()))):
            coarse = coarse.with_own(np.flatnonzero(self.since[0] == number))
        return replace(problem, coarse=coarse)


def lags(now: Evaluation) -> np.ndarray:
    """(P,) each point's share of what is left in all load steps: Σ (f̂ − q) keq⁻¹ (f̂ − q), over that of all ranks' points."""
    pairs = now.problem.local.pairs
    apart = now.local.force - pairs.traces(*now.fields.extended).force
    left = sum((one * pairs.points.compliance(one)).sum(axis=0) for one in apart)
    whole, = now.problem.space.team.sum(left[pairs.mine].sum())
    return left / whole if whole > 0 else left


def traces_of(now: Evaluation, points: np.ndarray) -> np.ndarray:
    """(q,) int, ascending, this rank's trace dofs at points (P,) bool."""
    pairs = now.problem.local.pairs
    dofs = np.concatenate([side[:, points][pairs.free[:, points]] for side in (pairs.transfer.one, pairs.transfer.two)])
    return np.unique(dofs[(dofs >= 0) & (dofs < now.problem.space.size)])
