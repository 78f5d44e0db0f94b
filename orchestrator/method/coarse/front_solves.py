"""Solutions by the factors of fronts, compiled. To be imported where it is used: it takes the compiler along."""

from __future__ import annotations

import numba
import numpy as np

from orchestrator.compiled import SUMS, compiled


@compiled
def forward(fronts, factors, x):
    """Eliminate from right-hand sides x (bodies, size), in the order of elimination, what is in fronts, one after the other.

    factors : ``layout``, ``own`` and ``beside`` as for ``eliminate``
    """
    layout, own_parts, _ = factors
    _, band, sizes, places, starts, _, _, _, _, rests, rest, _ = layout
    size, flat, z = x.shape[1], x.reshape(-1), np.empty(band)
    for f in fronts:
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + (a + m) * a].reshape(a + m, a)
        own = flat[size * starts[f] : size * starts[f] + a]
        for p in range(0, a, band):
            q = min(p + band, a)
            part = own[p:q]
            for i in range(p, q):
                z[i - p] = _times_each(L[i, p:q], part)
            for i in range(p, q):
                own[i] = z[i - p]
            for i in range(q, a):
                own[i] -= _times_each(L[i, p:q], part)
        i = a
        for u in range(rests[f], rests[f + 1]):
            other = x[rest[u]]
            for c in range(size):
                other[c] -= _times_each(L[i], own)
                i += 1


@compiled
def backward(fronts, factors, x):
    """Replace what ``forward`` has left by the solution, the last of the fronts first."""
    layout, own_parts, beside = factors
    _, band, sizes, places, starts, _, _, _, _, rests, rest, _ = layout
    size, flat = x.shape[1], x.reshape(-1)
    seen = np.empty(len(flat))
    for k in range(len(fronts) - 1, -1, -1):
        f = fronts[k]
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + a * a].reshape(a, a)
        U = beside[places[f, 1] : places[f, 1] + a * m].reshape(a, m)
        own, others = flat[size * starts[f] : size * starts[f] + a], seen[:m]
        for u in range(rests[f], rests[f + 1]):
            for c in range(size):
                others[size * (u - rests[f]) + c] = x[rest[u], c]
        for i in range(a):
            own[i] -= _times_each(U[i], others)
        for p in range((a - 1) // band * band, -1, -band):
            q = min(p + band, a)
            for i in range(p, q):
                own[i] -= _times_each(L[i, q:], own[q:])


@numba.njit(nogil=True, fastmath=SUMS, inline="always")
def _times_each(row, other):
    total = 0.0
    for j in range(len(row)):
        total += row[j] * other[j]
    return total

