"""Perfect interface: no jump, d = 0, so f̂ = F (paper, eq. 7)."""

from __future__ import annotations

import numpy as np

from orchestrator.laws.points import BONDED, Answer, Points


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """f̂ = F.

    Parameters
    ----------
    F : (3, P) predicted force on side 1
    previous : (3, P) jump at the previous load step, of no influence here
    derivative : also return ∂f̂/∂F
    """
    count = F.shape[1]
    answer = Answer(F, np.full(count, BONDED))
    if derivative:
        answer.active, answer.derivative = np.arange(count), np.broadcast_to(np.eye(3)[:, :, None], (3, 3, count))
    return answer
