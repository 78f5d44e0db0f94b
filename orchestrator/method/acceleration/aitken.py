"""Aitken's relaxation: α follows from the last two residuals, and nothing else is kept.

    α ← −α r₀·(r − r₀)/‖r − r₀‖²

r₀ and r being the residuals F(s) − s before and after a step α r₀ (Irons & Tuck, Int. J. Numer. Meth. Engng 1, 1969;
Küttler & Wall, Comput. Mech. 43, 2008). All load steps share one α.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.acceleration.base import squared_weights
from orchestrator.method.acceleration.relaxation import Relaxation, usual_relaxation
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.parallel.team import ALONE, Team


class Aitken(Relaxation):
    """Relaxation by the last two residuals.

    Parameters
    ----------
    relaxation : α of the first step
    weight : (D,) squared weights of the norm
    team : the ranks that share the state
    """

    title = "Aitken's relaxation"

    def __init__(self, relaxation: float, weight: np.ndarray, team: Team = ALONE):
        super().__init__(relaxation)
        self.weight, self.team, self.residual = weight, team, None

    @classmethod
    def of(cls, d: Decomposition, method) -> Aitken:
        """As the base class says."""
        return cls(usual_relaxation(d, method), squared_weights(d), d.space.team)

    def take(self, evaluated: Admissible, image: np.ndarray) -> np.ndarray:
        """As the base class says."""
        before = self.residual
        super().take(evaluated, image)
        if before is not None:
            change = self.weight * (self.residual - before)
            along, square = self.team.sum(np.vdot(change, before), np.vdot(change, self.residual - before))
            if square > 0:
                self.relaxation *= float(-along / square)
        return self.residual
