"""When iterations end, and what that is called in ``stop_reason``.

- ``converged``: the stopping criterion holds
- ``diverged``: the residual is not finite, or displacements have grown beyond all that a convergent run shows
- ``stagnated at rounding``: the residual is down at rounding level and has not halved for ``STALL`` stages
- ``held by stabilisation alone``: all has settled, but springs carry more than the tolerance: the laws have no balance
- ``max_iterations``: as many as were allowed
"""

from __future__ import annotations

import math
from collections.abc import Mapping

DIVERGED = "diverged"
STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
RUNAWAY = 1e6  # growth of the displacement that no convergent run shows
LOOSE = 10.0  # the same times ε: a body that springs alone hold goes 1/ε times as far as its load would deform it


class Ending:
    """Watches the iterations of one batch of load steps for their end.

    Parameters
    ----------
    last : iteration after which there is no other
    epsilon : the smallest ε of springs of stabilisation; infinite where there are none
    """

    def __init__(self, last: int, epsilon: float = math.inf):
        self.last, self.runaway = last, max(RUNAWAY, LOOSE / epsilon)
        self.reach = 0.0  # largest interface displacement of the first stage that moved
        self.residuals: list[float] = []

    def reason(self, iteration: int, met: bool, residual: float, moved: float, springs: bool = False) -> str | None:
        """Why this iteration is the last one; None where another follows.

        Parameters
        ----------
        met : whether the stopping criterion holds
        residual : ‖F(s) − s‖ relative
        moved : largest interface displacement
        springs : whether stabilisation keeps a balance that the laws do not have
        """
        self.reach = self.reach or moved
        self.residuals.append(residual)
        if met:
            return "converged"
        if not math.isfinite(residual) or moved > self.runaway * self.reach > 0:
            return DIVERGED
        if springs:
            return "held by stabilisation alone"
        if self._stalled():
            return "stagnated at rounding"
        return None if iteration < self.last else "max_iterations"

    @property
    def notes(self) -> dict[str, object]:
        """For the ``Memory`` of an iteration: what has been watched so far."""
        return {"reach": self.reach, "residuals": list(self.residuals)}

    def recall(self, notes: Mapping[str, object]) -> None:
        """Take ``notes`` back."""
        self.reach, self.residuals = notes["reach"], list(notes["residuals"])

    def _stalled(self) -> bool:
        """Rounding has been reached and nothing improves any more."""
        if len(self.residuals) <= STALL or self.residuals[-1] > ROUNDING:
            return False
        return min(self.residuals[-STALL:]) > 0.5 * min(self.residuals[:-STALL])
