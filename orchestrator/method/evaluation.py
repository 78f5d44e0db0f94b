"""One iteration as those see it who watch it, and what they say of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.indicator import Measures
from orchestrator.method.stopping.law_residuals import LawResiduals
from orchestrator.method.stopping.lengths import Lengths


@dataclass(frozen=True)
class Verdict:
    """What a monitor says of an iteration, or all that have been asked so far together.

    met : whether the stopping criterion holds; None: no word on it
    reason : why this iteration is the last one; empty where another follows
    changes : names of the monitors that change the problem before the next iteration
    anew : the acceleration begins anew with this iteration's state
    measure : what has been compared with the tolerance; nan where it is not known
    bound : error bound and energy of the best fields, as far as they are known
    laws : measures of the interface laws; lengths : what these are relative to
    sweeps : back-substitutions per subdomain and load step that judging has cost
    told : name → value for those who listen, see ``events.Iteration``
    warnings : sentences for the user
    """

    met: bool | None = None
    reason: str = ""
    changes: tuple[str, ...] = ()
    anew: bool = False
    measure: float = math.nan
    bound: Bound | None = None
    laws: LawResiduals | None = None
    lengths: Lengths | None = None
    sweeps: float = 0.0
    told: Mapping[str, object] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def and_then(self, later: Verdict) -> Verdict:
        """Both together; of what both speak of, the later word counts."""
        return Verdict(self.met if later.met is None else later.met, later.reason or self.reason, self.changes + later.changes,
            self.anew or later.anew, self.measure if math.isnan(later.measure) else later.measure,
            later.bound or self.bound, later.laws or self.laws, later.lengths or self.lengths, self.sweeps + later.sweeps,
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
