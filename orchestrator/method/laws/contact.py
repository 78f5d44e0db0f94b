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
    p = points.along(F) + points.stiff_n * points.gap
    active = np.flatnonzero(p < 0)
    p, stiff_t, friction = p[active], points.stiff_t[active], points.friction[active]
    # a row per component: numpy is several times faster along long rows than across short ones
    n, trial, before = (np.ascontiguousarray(x[active].T) for x in (points.normal, F, previous))
    trial -= stiff_t * before
    trial -= _dot(trial, n) * n
    size = np.sqrt(_dot(trial, trial))
    limit = friction * np.abs(p)
    slips = (size > limit) | (friction == 0)
    turn = limit / np.where(size > 0, size, 1.0)
    result, status = np.zeros(F.shape), np.full(len(F), OPEN)
    result[active] = (p * n + np.where(slips, turn, 1.0) * trial).T
    status[active] = np.where(slips, SLIP, STICK)
    if not derivative:
        return Answer(result, status)

    slope = np.broadcast_to(np.eye(3), (len(active), 3, 3)).copy()
    sliding = np.flatnonzero(slips)
    n, e = n.T[sliding], (trial / np.where(size > 0, size, 1.0)).T[sliding]
    normal = n[:, :, None] * n[:, None, :]
    # slip: f̂_t = −μ p e, whose direction e turns with the trial force
    turn = np.where(size > 0, turn, 0.0)[sliding, None, None]
    slope[sliding] = (normal - (friction[sliding, None] * e)[:, :, None] * n[:, None, :]
                      + turn * (np.eye(3) - normal - e[:, :, None] * e[:, None, :]))
    return Answer(result, status, active, slope)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(P,) products of vectors (3, P)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
