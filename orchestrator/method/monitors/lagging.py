"""Points that lag behind: where a run becomes slow near its end, and a few points carry what is left, these are solved exactly.

A few points may keep a run from its end: four grains that meet at a node and hold each other by much friction, a grain that touches
its neighbours at three. There an iteration contracts hardly or goes round in statuses, the acceleration has no direction for
them, and all others wait. So they are eliminated: their traces become fields of the coarse contact problem, which then solves their
laws as they are, together with how bodies move (nonlinear elimination: Cai & Li, SIAM J. Sci. Comput. 33, 2011).

Where several interfaces that open meet at a node, what is left when the rest is small may be self-stress; the coarse
contact problem corrects it from then on, and the acceleration begins anew, as an iteration answers otherwise.
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
# is no room for so many of a body.
SHARE, FEWER = 0.01, 7


class LaggingPoints(Monitor):
    """Gives points that lag behind fields of their own.

    mark : iteration and residual that a later one is compared with
    resting : whether the law residual has been small
    own, chosen : (D,) bool, which trace dofs of this rank are fields of their own, and which are to be; most : of these, of any body
    """

    name = "lagging"

    def __init__(self, space: TraceSpace):
        self.mark, self.resting = (0, 1.0), False
        self.own = self.chosen = np.zeros(space.size, bool)
        self.most = 0

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
        self.chosen, coarse = self.fitting(now), now.problem.coarse
        if not now.problem.space.team.max(float((self.chosen != self.own).any()))[0]:
            return Verdict()
        self.most = coarse.most(np.flatnonzero(self.chosen))
        return Verdict(changes=(self.name,), sweeps=self.most / now.problem.steps)

    def fitting(self, now: Evaluation) -> np.ndarray:
        """(D,) bool, trace dofs of this rank that are to be fields of their own: of each body those that are and, of the farthest behind,
        as many as it has room for beside them. Where it has room for none, those that are give way."""
        space, left, result = now.problem.space, lags(now), self.own.copy()
        owner = space.owner[: space.size]

        def count(dofs: np.ndarray) -> np.ndarray:
            return np.bincount(owner[dofs], minlength=space.link.subdomain_count)

        behind = [traces_of(now, left > SHARE * 2**k) for k in range(FEWER)]
        waiting = count(behind[0] & ~self.own) > 0  # bodies
        for kept in (self.own, np.zeros_like(self.own)):
            for some in behind:
                fits = waiting & (count(some & ~self.own) > 0) & (count(kept | some) <= now.problem.coarse.room)
                result = np.where(fits[owner], kept | some, result)
                waiting &= ~fits
        return result

    def change(self, now: Evaluation) -> Decomposition:
        self.own = self.chosen
        return self._with_own(now.problem, self.most)

    def _with_own(self, problem: Decomposition, most: int) -> Decomposition:
        return replace(problem, coarse=problem.coarse.with_own(np.flatnonzero(self.own), most))

    def state(self) -> dict[str, Any]:
        return {"trace/own": self.own[None].astype(float), "mark": list(self.mark), "resting": self.resting}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        self.own, self.mark, self.resting = state["trace/own"][0] > 0, tuple(state["mark"]), state["resting"]
        most = problem.coarse.most(np.flatnonzero(self.own))
        return self._with_own(problem, most) if most else problem


def lags(now: Evaluation) -> np.ndarray:
    """(P,) each point's share of what is left in all load steps: Σ (f̂ − q) keq⁻¹ (f̂ − q), over that of all ranks' points."""
    pairs = now.problem.local.pairs
    apart = now.local.force - pairs.traces(*now.fields.extended).force
    left = sum((one * pairs.points.compliance(one)).sum(axis=0) for one in apart)
    whole, = now.problem.space.team.sum(left[pairs.mine].sum())
    return left / whole if whole > 0 else left


def traces_of(now: Evaluation, points: np.ndarray) -> np.ndarray:
    """(D,) bool, this rank's trace dofs at points (P,) bool."""
    pairs = now.problem.local.pairs
    dofs = np.concatenate([side[:, points][pairs.free[:, points]] for side in (pairs.transfer.one, pairs.transfer.two)])
    result = np.zeros(now.problem.space.size, bool)
    result[dofs[(dofs >= 0) & (dofs < len(result))]] = True
    return result


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
