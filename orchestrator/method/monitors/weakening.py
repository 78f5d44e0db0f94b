"""When springs of stabilisation stay where they are, and become weaker.

Springs of ``auto`` begin anew in every iteration (``interface.stabilisation``) and carry nothing in
the end. What has no balance is never done with: where springs carry more than the tolerance and all
else has settled, or they have carried about as much for ``PATIENCE`` iterations, they stay where
they are from then on, so that all else comes to rest against them and a limit load can be told from
a body on its way.

Springs that stay become weaker where they alone keep a run from its end: a body that goes far in a
load step needs it, or the energy error stands still on them, which falls with ε unless something
else is left of it. What has no balance loads them as before, however weak they are; it is
``monitors.limit_load`` that ends such a run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import Any

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.stabilisation import ANEW, allowed_residual
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict

WEAKER = 0.1  # ε over the one before
FAINTEST = 1e-14  # the least ε: what such springs carry is rounding of what points do
# iterations in which what springs carry has to fall to such a share, where they begin anew
PATIENCE, FALLS = 10, 0.9
# of what springs carried when they became weaker last, below which that has served the energy error
LESS = 0.5


class Weakening(Monitor):
    """Weakens the springs of one case.

    allowed : law residual that the tolerance stands for
    at : iterations after which springs have become weaker by a factor of ten, more than once where
        by more
    carried : what springs carried when they became weaker last
    least : what springs that begin anew have carried at least, and when that fell last
    stays : iteration after which they have begun anew no more; 0: none
    """

    name, remembered = "weakening", ("at", "carried", "least", "stays")

    def __init__(self, allowed: float):
        self.allowed, self.at, self.stays = allowed, [], 0
        self.carried, self.least = math.inf, (math.inf, 0)

    @classmethod
    def of(cls, case: Case) -> Weakening | None:
        problem = case.problem
        if (
            problem.all_perfect
            or problem.coarse is None
            or problem.local.pairs.stabilisation is None
        ):
            return None
        return cls(allowed_residual(case.method.tolerance)) if problem.coarse.anew else None

    def judge(self, now: Evaluation) -> Verdict:
        verdict, problem = now.verdict, now.problem
        if problem.coarse.anew and verdict.laws.springs <= FALLS * self.least[0]:
            self.least = verdict.laws.springs, now.number
        if verdict.changes or verdict.reason or now.last:
            return Verdict()
        changes = self.stands(now) if problem.coarse.anew else self.due(verdict,
                                                                        problem.local.pairs.springs)
        return Verdict(False, changes=(self.name,), anew=True) if changes else Verdict()

    def stands(self, now: Evaluation) -> bool:
        """Whether springs that begin anew carry for good what nothing else does."""
        laws = now.verdict.laws
        return laws.held_by_springs(self.allowed) or (laws.springs > self.allowed
                                                      and now.number >= self.least[1] + PATIENCE)

    def due(self, verdict: Verdict, springs: float) -> int:
        """How many times springs that stay are to become weaker; all ranks see the same.

        springs : ε over that at the beginning
        """
        laws, epsilon = verdict.laws, springs * ANEW
        if laws.held_by_springs(self.allowed):  # what has no balance goes ten times as far
            return int(WEAKER * epsilon >= FAINTEST)
        if verdict.excess and laws.springs <= LESS * self.carried:  # the error falls with ε
            return max(1, math.ceil(math.log(1 / verdict.excess, WEAKER)))
        return 0

    def change(self, now: Evaluation) -> Decomposition:
        if now.problem.coarse.anew:
            self.stays = now.number
            return anchored(now.problem)
        times = self.due(now.verdict, now.problem.local.pairs.springs)
        self.at += [now.number] * times
        self.carried = now.verdict.laws.springs
        return weakened(now.problem, WEAKER ** times)

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        super().restore(state, problem)
        self.least = tuple(self.least)
        for _ in self.at:
            problem = weakened(problem, WEAKER)
        return anchored(problem) if self.stays else problem

    def found(self, problem: Decomposition) -> list[dict[str, Any]]:
        return [{"after": sorted(set(self.at)), "springs": problem.local.pairs.springs}]


def weakened(d: Decomposition, share: float) -> Decomposition:
    """Scale the springs of stabilisation to that share of ε."""
    return d.meeting(d.local.pairs.weakened(share), d.coarse and d.coarse.weakened(share))


def anchored(d: Decomposition) -> Decomposition:
    """Let springs of stabilisation begin anew no more."""
    coarse = copy(d.coarse)
    coarse.anew = False
    return replace(d, coarse=coarse)
