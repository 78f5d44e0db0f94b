"""Imposed jump: d = d₀, so f̂ = F − keq d₀. A bolt is tightened by one."""

from __future__ import annotations

import numpy as np

from orchestrator.laws import perfect
from orchestrator.laws.points import Answer, Points


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """f̂ = F − keq d₀; parameters as in ``perfect.force``."""
    return perfect.force(points, F - points.stiffness(points.jump), previous, derivative)
