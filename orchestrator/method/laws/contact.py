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

from orchestrator.method.laws.points import OPEN, SLIP, STICK, Answer, Points


def force(points: Points, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
    """The force a contact carries.

    Parameters
    ----------
    F : (P, 3) predicted force on side 1
    previous : (P, 3) jump at the previous load step; its tangential part is where friction sticks
    derivative : also return ∂f̂/∂F where the contact is closed
    """
    n = points.normal
    p = points.along(F) + points.stiff_n * points.gap
    closed = p < 0
    trial = F - points.stiff_t[:, None] * previous
    trial -= points.along(trial)[:, None] * n
    size = np.sqrt(np.einsum("pi,pi->p", trial, trial))
    limit = points.friction * np.abs(p)
    slips = closed & ((size > limit) | (points.friction == 0))
    direction = trial / np.where(size > 0, size, 1.0)[:, None]
    tangential = np.where(slips[:, None], limit[:, None] * direction, trial)
    result = np.where(closed[:, None], p[:, None] * n + tangential, 0.0)
    status = np.where(closed, np.where(slips, SLIP, STICK), OPEN)
    if not derivative:
        return Answer(result, status)

    active = np.flatnonzero(closed)
    slope = np.broadcast_to(np.eye(3), (len(active), 3, 3)).copy()
    sliding = np.flatnonzero(slips[active])
    rows = active[sliding]
    n, e = n[rows], direction[rows]
    normal = n[:, :, None] * n[:, None, :]
    # slip: f̂_t = −μ p e, whose direction e turns with the trial force
    turn = np.where(size[rows] > 0, limit[rows] / np.where(size[rows] > 0, size[rows], 1.0), 0.0)[:, None, None]
    slope[sliding] = (normal - (points.friction[rows, None] * e)[:, :, None] * n[:, None, :]
                      + turn * (np.eye(3) - normal - e[:, :, None] * e[:, None, :]))
    return Answer(result, status, active, slope)
