"""What other ranks have told of evaluations, carried to their affine combinations: nothing travels for these.

Traces of the neighbours, class sums of displacements and what traces ask of rigid motions are affine functions of the state.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.stopping.bound import ErrorBound


class Carried:
    """Among ranks; a single one has nothing to carry.

    Parameters
    ----------
    stage : linear stage
    bound : what is summed is for it
    """

    def __init__(self, stage: LinearStage, bound: ErrorBound):
        self.stage, self.bound = stage, bound

    @property
    def weight(self) -> np.ndarray:
        """(B,) of displacements whose class sums travel with the traces, see ``Admissible.send``."""
        return self.bound.continuity.weight

    def of(self, fields: Admissible) -> list[np.ndarray]:
        """The neighbours' w and f, (T, G) each, and class sums (T, classes)."""
        size = fields.space.size
        w, f = fields.extended
        return [w[:, size:], f[:, size:], fields.sums]

    def put(self, fields: Admissible, point: list[np.ndarray]) -> None:
        """Into fields whose traces (T, D) are known what belongs to them: ``of`` these, and the pull of all ranks."""
        w, f, fields.sums, fields.pull = point
        fields.extended = np.hstack([fields.w, w]), np.hstack([fields.f, f])

    def difference(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """Fields of the difference of two states, their traces under way."""
        fields = self.stage.difference(s, u, alpha)
        fields.send(self.weight)
        return fields

    def evaluated(self, s: np.ndarray, u: np.ndarray, alpha: np.ndarray) -> Admissible:
        """Fields of a state, their traces under way."""
        fields = self.stage.complete(s, u, alpha)
        fields.send(self.weight)
        return fields
