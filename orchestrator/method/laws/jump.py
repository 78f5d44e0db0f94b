"""Imposed jump: d = d₀, so f̂ = F − keq d₀. A bolt is tightened by one."""

from __future__ import annotations

import numpy as np

from orchestrator.method.laws.points import BONDED, Answer, Points


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """f̂ = F − keq d₀; parameters as in ``perfect.force``."""
    slope = np.broadcast_to(np.eye(3), (len(F), 3, 3)) if derivative else None
    return Answer(F - points.stiffness(points.jump), np.full(len(F), BONDED), slope)
