"""Loops of contact with friction over node pairs, compiled."""

from __future__ import annotations

import math

import numpy as np

from orchestrator.compiled import compiled

OPENS, STICKS, SLIPS = 0, 1, 2  # numbers of the statuses


@compiled
def forces(start, stop, points, F, previous, force, status):
    """Write f̂ (3, P) and status (P,) at predicted forces F (3, P), of pairs from start to stop.

    points : normal, stiff_n and stiff_t as in ``Points``, gap and friction
    """
    normal, stiff_n, stiff_t, gap, friction = points
    part = slice(start, stop)  # of the points
    normal, F, previous, force = normal[:, part], F[:, part], previous[:, part], force[:, part]
    stiff_n, stiff_t, gap, friction = stiff_n[part], stiff_t[part], gap[part], friction[part]
    status = status[part]
    for q in range(stop - start):
        n0, n1, n2 = normal[0, q], normal[1, q], normal[2, q]
        p = F[0, q] * n0 + F[1, q] * n1 + F[2, q] * n2 + stiff_n[q] * gap[q]
        if p >= 0.0:
            force[0, q] = force[1, q] = force[2, q] = 0.0
            status[q] = OPENS
            continue
        t0 = F[0, q] - stiff_t[q] * previous[0, q]
        t1 = F[1, q] - stiff_t[q] * previous[1, q]
        t2 = F[2, q] - stiff_t[q] * previous[2, q]
        along = t0 * n0 + t1 * n1 + t2 * n2
        t0, t1, t2 = t0 - along * n0, t1 - along * n1, t2 - along * n2
        size, share = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2), 1.0
        limit = -friction[q] * p
        status[q] = STICKS
        if size > limit or friction[q] == 0.0:
            status[q] = SLIPS
            share = limit / size if size > 0.0 else 0.0
        force[0, q] = p * n0 + share * t0
        force[1, q] = p * n1 + share * t1
        force[2, q] = p * n2 + share * t2


@compiled
def slopes(start, stop, points, F, previous, active, slope):
    """∂f̂/∂F (3, 3, Q) at the closed pairs ``active`` (Q,) int, of these from start to stop.

    Stick: 1; slip: n nᵀ − μ e nᵀ + turn (1 − n nᵀ − e eᵀ), as f̂_t = −μ p e
    turns with the trial force T = |T| e.
    """
    n, e = np.empty(3), np.empty(3)
    normal, stiff_n, stiff_t, gap, friction = points
    for r in range(start, stop):
        q = active[r]
        p, along = stiff_n[q] * gap[q], 0.0
        for c in range(3):
            n[c] = normal[c, q]
            e[c] = F[c, q] - stiff_t[q] * previous[c, q]
            p += F[c, q] * n[c]
            along += e[c] * n[c]
        square = 0.0
        for c in range(3):
            e[c] -= along * n[c]
            square += e[c] * e[c]
        size, turn, steep, curved = math.sqrt(square), 1.0, 0.0, 0.0
        limit = -friction[q] * p
        if size > limit or friction[q] == 0.0:
            turn = limit / size if size > 0.0 else 0.0
            steep, curved = friction[q], turn
        for c in range(3):
            e[c] = e[c] / size if size > 0.0 else 0.0
        for c in range(3):
            for d in range(3):
                slope[c, d, r] = ((1.0 - turn) * n[c] - steep
                                  * e[c]) * n[d] - curved * e[c] * e[d]
            slope[c, c, r] += turn
