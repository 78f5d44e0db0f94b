"""Monitors of the iterations, one file each: a monitor judges every one, and may end the run,
change the problem, or tell something.

To add one, derive from ``Monitor`` and enter the class in ``registry.MONITORS``, at the place where
it is to be asked. Hooks, all optional but ``judge``:

    of(case)                    a monitor for load steps that are solved together, or None
    judge(now)                  what it says of an iteration; ``now.verdict``: those before it
    change(now)                 the problem of the next iteration, where its verdict says so
    passed(d, ended, left)      what the next increment begins with
    found(problem)              what is delivered of it

With several ranks all of them ask all monitors: what is compared has to be the same everywhere, as
sums over the ranks are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairs import History
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local_stage import LocalState
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.method.stopping.indicator import Measures
from orchestrator.method.stopping.law_residuals import LawResiduals, LengthScale, Lengths
from orchestrator.registry import MONITORS

FIRST = 0.1  # what ``error: auto`` begins with, before there is an estimate


@dataclass(frozen=True)
class Verdict:
    """Verdict of a monitor on an iteration, or all that have been asked so far together.

    met : whether the stopping criterion holds; None: no word on it
    reason : why this iteration is the last one; empty where another follows
    led : whether that is so of the state that the way here has led to, and another way, of smaller
        load steps, may lead elsewhere
    changes : names of the monitors that change the problem before the next iteration
    anew : the acceleration begins anew with this iteration's state
    excess : the error over what springs may leave of it, where it stands still while the laws come
        to hold; 0: it does not
    measure : what has been compared with the tolerance; nan where it is not known
    bound : error bound and energy of the best fields, as far as they are known
    laws : measures of the interface laws; lengths : what these are relative to
    target : name of what has been compared, and the tolerance
    sweeps : back-substitutions per subdomain and load step that judging has cost
    told : name → value for those who listen, see ``events.Iteration``
    warnings : sentences for the user
    """

    met: bool | None = None
    reason: str = ""
    led: bool = False
    changes: tuple[str, ...] = ()
    anew: bool = False
    excess: float = 0.0
    measure: float = math.nan
    bound: Judged | None = None
    laws: LawResiduals | None = None
    lengths: Lengths | None = None
    target: tuple[str, float] = ("", math.nan)
    sweeps: float = 0.0
    told: Mapping[str, object] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def and_then(self, later: Verdict) -> Verdict:
        """Both together; of what both speak of, the later word counts."""
        return Verdict(self.met if later.met is None else later.met, later.reason or self.reason,
                       self.led or later.led,
            self.changes + later.changes, self.anew or later.anew, max(self.excess, later.excess),
                       self.measure if math.isnan(later.measure) else later.measure,
            later.bound or self.bound, later.laws or self.laws, later.lengths or self.lengths,
                       later.target if later.target[0] else self.target,
                       self.sweeps + later.sweeps,
                       {**self.told, **later.told}, self.warnings + later.warnings)


@dataclass
class Evaluation:
    """One iteration: both stages, and what is known of them.

    number : linear stages after set-up, this one included
    last : no other is allowed
    problem : what was solved
    point : what the acceleration has taken in
    fields : of the linear stage, with the coarse contact problem
    best : the fields that would be delivered
    local : the local stage
    measures : indicator, residual, …
    verdict : what has been said so far
    """

    number: int
    last: bool
    problem: Decomposition
    point: Admissible
    fields: Admissible
    best: Admissible
    local: LocalState
    measures: Measures | None = None
    verdict: Verdict = Verdict()

    @property
    def held(self) -> bool:
        """Whether all has settled, and springs of stabilisation that stay where they are carry more
        than the tolerance.
        """
        verdict, coarse = self.verdict, self.problem.coarse
        on_the_way = coarse is not None and coarse.anew
        return verdict.laws is not None and not on_the_way and verdict.laws.held_by_springs(
            verdict.target[1])


@dataclass
class Case:
    """Case that monitors are made for: load steps that are solved together.

    problem : the decomposition for these load steps, as it is at the beginning
    method : ``method`` of the configuration
    numbers : of these load steps, from 1, for people
    whole : the decomposition for all load steps; None: it is ``problem``
    before : results of the increments that have ended
    given : what a run hands to its monitors by name, errors that the whole scene tells
        (``estimate``, ``true_error``), and what monitors keep for those of later increments
    value : below which the measure has to fall; with ``error: auto`` it follows the estimate
    """

    problem: Decomposition
    method: Any
    numbers: Sequence[int]
    whole: Decomposition | None = None
    before: Sequence[Any] = ()
    given: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tolerance = self.method.tolerance
        self.by_error, self.follows = tolerance.indicator is None, tolerance.error == "auto"
        self.value: float = FIRST if self.follows else (tolerance.error or tolerance.law
                                                        or tolerance.indicator)

    @cached_property
    def lengths(self) -> LengthScale:
        """Return what displacements are compared with: a load step may unload, so that it counts
        what the scene was told in all of them.
        """
        scale = LengthScale(self.problem)
        if self.whole is not None and self.whole is not self.problem:
            scale.told = max(scale.told, LengthScale(self.whole).told)
        return scale


class Monitor:
    """Watches the iterations of one case.

    name : as in the registry
    remembered : its attributes that a resumed run has to know: numbers, texts and lists of these,
        and arrays (T, …) as ``kind/name``, see ``checkpoint``
    """

    name: ClassVar[str]
    remembered: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def of(cls, case: Case) -> Monitor | None:
        """The monitor of a case; None where it has nothing to watch."""
        return cls()

    def judge(self, now: Evaluation) -> Verdict:
        """Return what it says of an iteration."""
        raise NotImplementedError

    def change(self, now: Evaluation) -> Decomposition:
        """The problem of the next iteration, if the verdict has said that it changes and another
        iteration follows.
        """
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """Return what a resumed run has to know, by the names in ``remembered``."""
        return {name: copy(getattr(self, _attribute(name))) for name in self.remembered}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        """Take ``state`` back; the problem as the monitor had changed it by then."""
        for name in self.remembered:
            setattr(self, _attribute(name), copy(state[name]))
        return problem

    def passed(self, d: Decomposition, ended: Any, left: History) -> tuple[Decomposition, History]:
        """Return what the next increment begins with: the decomposition for all load steps, and
        what this one has left.

        ended : the result of the increment, see ``Iterated``
        """
        return d, left

    def found(self, problem: Decomposition) -> list[Any]:
        """Return what is delivered of it once the iterations of the case have ended:
        ``Iterated.found[name]``.
        """
        return []


def _attribute(name: str) -> str:
    return name.rpartition("/")[2]


def monitors_of(case: Case) -> list[Monitor]:
    """Those that have something to watch, in the order of the registry."""
    return [monitor for kind in MONITORS.values() if (monitor := kind.of(case)) is not None]
