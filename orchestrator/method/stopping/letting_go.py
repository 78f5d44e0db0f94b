"""When the springs of stabilisation are let go: where they alone keep a run from its end.

How much a spring carries is ε keq times how far the load step has moved its pair. Where a body goes far that may be slightly
more than the tolerance, though no law needs it, and it stays as much while iterations go on. The springs are then set to carry
nothing where pairs stand, a step of the proximal point algorithm,

    f̂ = (1 − ε) law(F) + ε (F − keq (d_before + δ)),   δ = d* − d*_before, the change of the jumps d* at which they are let go

and hold back from there on alone what is still to come. It is done when

- they carry more than the tolerance, and at the pace of the last iteration would do so for another digit of the rest;
- nothing else is more than that digit above the tolerance, as letting go disturbs no more than is still to be iterated away; or
  the run would end as held by them;
- they carry no more than ``MOST`` tolerances, and half of what they carried when they were last let go: what has no balance
  loads them as before wherever they begin, and the run then ends as held by them. Each time halves what they carry.

Reference: Rockafellar, SIAM J. Control Optim. 14 (1976).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from orchestrator.method.stopping.law_residuals import LawResiduals

DIGIT = 10.0  # what is left when they are let go, over the tolerance; and the iterations that take a digit from it
MOST = 100.0  # tolerances that they may carry: with ε a quarter of one, bodies then move by hundreds of times what they are deformed
LESS = 0.5  # of what they carried when they were last let go, below which that has served


class LettingGo:
    """Watches what springs carry in the iterations of one batch of load steps.

    Attributes
    ----------
    at : iterations after which they have been let go
    """

    def __init__(self) -> None:
        self.at: list[int] = []
        self._carried, self._before = math.nan, math.nan

    def __call__(self, iteration: int, laws: LawResiduals, tolerance: float) -> bool:
        """Whether they are to be let go after this iteration; all ranks see the same."""
        springs, pace = laws.springs, abs(laws.springs - self._before)
        self._before = springs
        above, most = springs - tolerance, LESS * self._carried if self.at else MOST * tolerance
        near = DIGIT * pace < above and laws.largest_other <= DIGIT * tolerance or laws.held_by_springs(tolerance)
        if not (0 < above and near and springs <= most):
            return False
        self._carried = springs
        self.at.append(iteration)
        return True

    @property
    def notes(self) -> dict[str, object]:
        """For the ``Memory`` of an iteration."""
        return {"at": list(self.at), "carried": self._carried, "before": self._before}

    def recall(self, notes: Mapping[str, object]) -> None:
        """Take ``notes`` back."""
        self.at, self._carried, self._before = list(notes["at"]), notes["carried"], notes["before"]
