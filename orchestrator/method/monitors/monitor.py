"""What a monitor is: it judges every iteration, and may end the run, change the problem, or tell something.

To add one, derive from ``Monitor`` and enter the class in ``registry.MONITORS``, at the place where it is to be asked. It sees
what those before it have said as ``evaluation.verdict``. With several ranks all of them ask all monitors: what is compared has
to be the same everywhere, as sums over the ranks are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation, Verdict
from orchestrator.method.stopping.lengths import LengthScale
from orchestrator.registry import MONITORS

FIRST = 0.1  # what ``error: auto`` begins with, before there is an estimate


@dataclass
class Case:
    """What monitors are made for: load steps that are solved together.

    problem : the decomposition for these load steps, as it is at the beginning
    method : ``method`` of the configuration
    numbers : of these load steps, from 1, for people
    told : the least displacement that means something in any load step of the scene, see ``LengthScale``; 0: nobody knows
    given : what else a run hands to its monitors, by name: ``estimate``, ``true_error``, ``placing``
    value : below which the measure has to fall; with ``error: auto`` it follows the estimate
    """

    problem: Decomposition
    method: Any
    numbers: Sequence[int]
    told: float = 0.0
    given: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        tolerance = self.method.tolerance
        self.by_error = tolerance.error is not None
        self.value: float = FIRST if tolerance.error == "auto" else tolerance.error if self.by_error else tolerance.indicator

    @cached_property
    def lengths(self) -> LengthScale:
        """What displacements are compared with."""
        scale = LengthScale(self.problem)
        scale.told = max(scale.told, self.told)
        return scale


class Monitor:
    """Watches the iterations of one case.

    name : as in the registry
    """

    name: ClassVar[str]

    @classmethod
    def of(cls, case: Case) -> Monitor | None:
        """The monitor of a case; None where it has nothing to watch."""
        return cls()

    def judge(self, now: Evaluation) -> Verdict:
        """What it says of an iteration."""
        raise NotImplementedError

    def change(self, now: Evaluation) -> Decomposition:
        """The problem of the next iteration, if the verdict has said that it changes and another iteration follows."""
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """What a resumed run has to know: numbers, texts and lists of these by name, arrays by ``kind/name``, see ``checkpoint``."""
        return {}

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        """Take ``state`` back; the problem as the monitor had changed it by then."""
        return problem

    def found(self, problem: Decomposition) -> list[Any]:
        """What is delivered of it once the iterations of the case have ended: ``Iterated.found[name]``."""
        return []


def monitors_of(case: Case) -> list[Monitor]:
    """Those that have something to watch, in the order of the registry."""
    return [monitor for kind in MONITORS.values() if (monitor := kind.of(case)) is not None]
