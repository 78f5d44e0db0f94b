"""Perfect interface: no jump, d = 0, so f̂ = F (paper, eq. 7)."""

from __future__ import annotations

import numpy as np

from orchestrator.method.laws.points import BONDED, Answer, Points


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """f̂ = F.

    Parameters
    ----------
    F : (P, 3) predicted force on side 1
    previous : (P, 3) jump at the previous load step, of no influence here
    derivative : also return ∂f̂/∂F
    """
    answer = Answer(F, np.full(len(F), BONDED))
    if derivative:
        answer.active, answer.derivative = np.arange(len(F)), np.broadcast_to(np.eye(3), (len(F), 3, 3))
    return answer
