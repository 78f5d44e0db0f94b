"""When springs of stabilisation become weaker: once loose bodies have found about where they are.

Stiff springs let loose bodies find their places quickly and carry what contacts should; weak ones carry next to nothing and take
many iterations from afar. So ``auto`` begins with ε of a quarter of what the tolerance allows, and goes on with a hundredth, and then a
thousandth of it, as soon as everything but the springs is within ``NEAR`` of the tolerance. Where springs alone then keep a
run from its end, they become weaker again: a body that goes far in a load step needs it, or the energy error stands still on them,
which falls with ε unless something else is left of it. What has no balance loads them as before, however weak they are; it is
``monitors.limit_load`` that ends such a run. Where very many bodies are loose the coarse contact problem may lose its way once springs are
weak: what is not as near again after ``LOST`` iterations goes on with the springs before, and the summary tells what they carry.

Where springs begin anew in every iteration (``interface.stabilisation``) they carry nothing in the end anyway. They become weaker as the
law residual falls, a digit at a time, so that bodies that are pushed by less go as far. What has no balance is never done with: where
springs carry more than the tolerance and have carried about as much for ``PATIENCE`` iterations they stay where they are from then
on, as others do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.stabilisation import allowed_residual, first
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.stopping.law_residuals import LawResiduals

WEAKER = 0.1  # ε over the one before
# How often at a time, and in all, before the energy error asks for more. A law residual of 1e-4 takes the 100 grains of
# configs/polycrystal_100.yaml 66 iterations with a thousandth of ε at the end, and was not reached in 70 with a ten-thousandth.
AT_ONCE, STAGES = 2, 3
# The least ε that springs are given where they do not keep a run from its end: rounding kept a block from its place that 2.5e-11
# alone held.
LEAST = 1e-10
FAINTEST = 1e-14  # the least ε where they do: what such springs carry is rounding of what points do
NEAR = 20.0  # of the tolerance: from there on the springs decide about what is left
# Iterations after which springs that became weaker are withdrawn. 27 to 125 grains were as near again after at most 12, to 1e-4.
LOST = 50
FOLLOWS = 1e-3  # ε over the law residual at least, where springs begin anew: 1e-5 takes half as many of Newton's steps again
PATIENCE, FALLS = 10, 0.9  # iterations in which what springs carry has to fall to such a share, where they begin anew
LESS = 0.5  # of what springs carried when they became weaker last, below which that has served the energy error


class Weakening(Monitor):
    """Weakens the springs of one case.

    allowed : law residual that the tolerance stands for
    first : ε to begin with
    at : iterations after which springs have become weaker by a factor of ten, more than once where by more
    carried, left : what springs carried when they became weaker last, and the largest residual beside
    near : the last iteration that was near the tolerance
    withdrawn : iteration after which the last step until then has been taken back, which is done once; 0: none has
    least : what springs that begin anew have carried at least, and when that fell last
    stays : iteration after which they have begun anew no more; 0: none
    """

    name, remembered = "weakening", ("at", "carried", "left", "near", "withdrawn", "least", "stays")

    def __init__(self, allowed: float, first: float):
        self.allowed, self.first, self.at, self.stays = allowed, first, [], 0
        self.near = self.withdrawn = 0
        self.carried, self.left, self.least = math.inf, 0.0, (math.inf, 0)

    @classmethod
    def of(cls, case: Case) -> Weakening | None:
        problem = case.problem
        if problem.all_perfect or problem.coarse is None or problem.local.pairs.stabilisation is None:
            return None
        if case.method.contact.stabilisation != "auto":
            return None
        return cls(allowed_residual(case.method.tolerance), first(problem.scene, case.method))

    def judge(self, now: Evaluation) -> Verdict:
        verdict, problem = now.verdict, now.problem
        if self.is_near(verdict.laws, bool(verdict.met)):
            self.near = now.number
        if problem.coarse.anew and verdict.laws.springs <= FALLS * self.least[0]:
            self.least = verdict.laws.springs, now.number
        if verdict.changes or verdict.reason or now.last:
            return Verdict()
        if self.stands(now) or self.lost(now):
            return Verdict(False, changes=(self.name,), anew=True)
        if self.due(verdict, problem.springs, problem.coarse.anew):
            return Verdict(False, changes=(self.name,), anew=not problem.coarse.anew)
        return Verdict()

    def stands(self, now: Evaluation) -> bool:
        """Whether springs that begin anew carry for good what nothing else does."""
        return now.problem.coarse.anew and now.verdict.laws.springs > self.allowed and now.number >= self.least[1] + PATIENCE

    def lost(self, now: Evaluation) -> bool:
        """Whether weaker springs have led away from the tolerance for good; those that begin anew lead nowhere else."""
        since = now.number - self.at[-1] if self.at and not now.problem.coarse.anew and not self.stays else 0
        return not self.withdrawn and since >= LOST and self.near <= self.at[-1]

    def is_near(self, laws: LawResiduals, met: bool) -> bool:
        """Whether everything but the springs is near the tolerance, or as it was when they became weaker; ``met``: the stopping
        criterion holds."""
        return met or laws.largest_other <= max(NEAR * self.allowed, self.left)

    def due(self, verdict: Verdict, springs: float, anew: bool) -> int:
        """How many times springs are to become weaker; all ranks see the same.

        springs : ε over that at the beginning
        anew : whether they begin anew in every iteration
        """
        laws, epsilon = verdict.laws, springs * self.first
        if anew:
            return 0 if verdict.met else self.behind(laws.largest_other, epsilon)
        if laws.held_by_springs(self.allowed):  # what has no balance goes ten times as far
            return int(WEAKER * epsilon >= FAINTEST)
        if self.withdrawn:
            return 0
        if verdict.excess and laws.springs <= LESS * self.carried:  # the error falls with ε
            return max(AT_ONCE, math.ceil(math.log(1 / verdict.excess, WEAKER)))
        times = min(AT_ONCE, STAGES - len(self.at))
        return times if times > 0 and WEAKER ** times * epsilon >= LEAST and self.is_near(laws, bool(verdict.met)) else 0

    @staticmethod
    def behind(residual: float, epsilon: float) -> int:
        """How many times ε is ten times as large as the law residual needs it."""
        if not math.isfinite(residual):
            return 0
        least = max(FOLLOWS * residual, FAINTEST)
        return max(0, math.floor(math.log10(epsilon / least)))

    def change(self, now: Evaluation) -> Decomposition:
        if self.stands(now):
            self.stays = now.number
            return now.problem.anchored()
        if self.lost(now):
            self.withdrawn = now.number
            return now.problem.weakened(WEAKER ** -self.taken_back)
        times = self.due(now.verdict, now.problem.springs, now.problem.coarse.anew)
        self.at += [now.number] * times
        self.carried, self.left = now.verdict.laws.springs, now.verdict.laws.largest_other
        return now.problem.weakened(WEAKER ** times)

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        super().restore(state, problem)
        self.least = tuple(self.least)
        for _ in self.at:
            problem = problem.weakened(WEAKER)
        if self.withdrawn:
            problem = problem.weakened(WEAKER ** -self.taken_back)
        return problem.anchored() if self.stays else problem

    @property
    def taken_back(self) -> int:
        """How many times springs had become weaker in the step that is withdrawn."""
        return self.at.count(max(after for after in self.at if after < self.withdrawn))

    def found(self, problem: Decomposition) -> list[dict[str, Any]]:
        return [{"after": sorted(set(self.at)), "springs": problem.springs, "withdrawn": self.withdrawn}]
