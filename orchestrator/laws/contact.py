"""Unilateral contact with Coulomb friction, closed form (Oumaziz et al., Comput. Mech. 60, 2017).

With p = F_n + keq_n g₀ the normal force if the gap were closed (negative in compression):

    p ≥ 0   open   f̂ = 0
    p < 0   closed f̂_n = p, and with T = F_t − keq_t d_t(previous step)
            |T| ≤ μ|p|  stick  f̂_t = T
            else        slip   f̂_t = μ|p| T/|T|

Friction 0 is a slip without resistance: f̂_t = 0.
"""

from __future__ import annotations

import numpy as np

from orchestrator.laws.points import OPEN, SLIP, STICK, Answer, Points, dot


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """The force a contact carries.

    Parameters
    ----------
    F : (3, P) predicted force on side 1
    previous : (3, P) jump at the previous load step; its tangential part is where friction sticks
    derivative : also return ∂f̂/∂F where the contact is closed
    """
    p = points.along(F) + points.stiff_n * points.gap
    active = np.flatnonzero(p < 0)
    p, friction, n = p[active], points.friction[active], points.normal.take(active, axis=1)
    trial = F.take(active, axis=1) - points.stiff_t[active] * previous.take(active, axis=1)
    trial -= dot(trial, n) * n
    size = np.sqrt(dot(trial, trial))
    limit = friction * np.abs(p)
    slips = (size > limit) | (friction == 0)
    turn = limit / np.where(size > 0, size, 1.0)
    result, status = np.zeros(F.shape), np.full(len(points.gap), OPEN)
    result[:, active] = p * n + np.where(slips, turn, 1.0) * trial
    status[active] = np.where(slips, SLIP, STICK)
    if not derivative:
        return Answer(result, status)

    # stick: 1; slip: n nᵀ − μ e nᵀ + turn (1 − n nᵀ − e eᵀ), as f̂_t = −μ p e turns with the trial force
    e = trial / np.where(size > 0, size, 1.0)
    turn = np.where(slips, np.where(size > 0, turn, 0.0), 1.0)
    steep = np.where(slips, friction, 0.0) * e
    curved = np.where(slips, turn, 0.0) * e
    slope = ((1 - turn) * n - steep)[:, None, :] * n - curved[:, None, :] * e
    for i in range(3):
        slope[i, i] += turn
    return Answer(result, status, active, slope)
