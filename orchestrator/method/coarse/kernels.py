"""Loops of the coarse contact problem over node pairs and blocks, compiled."""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled

# points to a product: enough for it to be quick, and what it takes stays in a core's own cache
TOGETHER = 64


@compiled
def spread(start, stop, L, chosen, bounds, both, F):
    """F (3, Q) += L y at some of the pairs, those of the interfaces from start to stop.

    L : (P, 3, 2n); chosen : (Q,) int, among these, interface after interface
    bounds : (I + 1,) int, where those of each interface start
    both : (I, 2n) fields of the two bodies
    """
    for i in range(start, stop):
        y = both[i]
        for q in range(bounds[i], bounds[i + 1]):
            row = L[chosen[q]]
            for c in range(3):
                total = 0.0
                for f in range(len(y)):
                    total += row[c, f] * y[f]
                F[c, q] += total


@compiled
def moved(start, stop, of, both, weight, result):
    """result (3, Q) = ω (1₃ ⊗ φ) A y at some of the pairs; as for ``spread`` and ``carried``."""
    _, phi, places, A, rows, shapes, chosen, bounds = of
    for i in range(start, stop):
        y, m = both[i], shapes[i]
        combined = np.empty(3 * m)
        for a in range(3 * m):
            total, along = 0.0, A[rows[i] + a]
            for f in range(len(y)):
                total += along[f] * y[f]
            combined[a] = total
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            first = places[i] + m * p
            for d in range(3):
                total = 0.0
                for j in range(m):
                    total += combined[d * m + j] * phi[first + j]
                result[d, q] = weight[p] * total


@compiled
def carried(start, stop, of, force, weight, result):
    """result (I, 2, n) = Aᵀ Σ ω f̂ ⊗ φ of forces (3, Q), first body and second body of each
    interface.

    of : L, φ, ``places``, A, ``rows`` and ``shapes`` as ``PairFields`` has them, chosen and bounds
        as for ``spread``; weight : (P,) ω
    """
    _, phi, places, A, rows, shapes, chosen, bounds = of
    half = A.shape[1] // 2
    for i in range(start, stop):
        result[i] = 0.0
        if bounds[i] == bounds[i + 1]:
            continue
        m = shapes[i]
        moments = np.zeros(3 * m)
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            first = places[i] + m * p
            for c in range(3):
                if force[c, q] != 0.0:
                    share = weight[p] * force[c, q]
                    for j in range(m):
                        moments[c * m + j] += share * phi[first + j]
        for a in range(3 * m):
            along = A[rows[i] + a]
            for side in range(2):
                for f in range(half):
                    result[i, side, f] += along[half * side + f] * moments[a]


@compiled
def slopes(start, stop, of, A, given, weight, result):
    """result (I, 2, 2, n, n) = Aᵀ Σ ω (∂f̂/∂F ⊗ φ) L of the interfaces from start to stop, blocks
    of the two bodies.

    of : as for ``carried``; A : the same in L's precision, that of all sums
    given : (R,) int, ascending, points among the chosen; (I + 1,) int, where those of each
        interface start; ∂f̂/∂F (3, 3, R)
    weight : (P,) ω
    """
    (L, phi, places, _, rows, shapes, chosen, _), (active, first, derivative) = of, given
    size, half = L.shape[2], L.shape[2] // 2
    fields, share, whole = np.empty((3 * TOGETHER, size),
                                    L.dtype), np.empty(TOGETHER), np.empty((size, size), L.dtype)
    for i in range(start, stop):
        if first[i] == first[i + 1]:
            result[i] = 0.0
            continue
        m = shapes[i]
        sums, some = np.zeros((3 * m, size), L.dtype), np.empty((3 * m, size), L.dtype)
        for r in range(first[i], first[i + 1], TOGETHER):
            count = min(TOGETHER, first[i + 1] - r)
            turned = np.empty((3 * m, 3 * count), L.dtype)
            for q in range(count):
                p = chosen[active[r + q]]
                for d in range(3):
                    for f in range(size):
                        fields[count * d + q, f] = L[p, d, f]
            for j in range(m):
                for q in range(count):
                    p = chosen[active[r + q]]
                    share[q] = weight[p] * phi[places[i] + m * p + j]
                for c in range(3):
                    for d in range(3):
                        row, slope = turned[c * m + j,
                                            count * d : count * d
                                            + count], derivative[c, d, r : r + count]
                        for q in range(count):
                            row[q] = share[q] * slope[q]
            np.dot(turned, fields[: 3 * count], some)
            sums += some
        np.dot(A[rows[i] : rows[i] + 3 * m].T, sums, whole)
        for row in range(2):
            for column in range(2):
                for f in range(half):
                    for g in range(half):
                        result[i, row, column, f, g] = whole[row * half + f, column * half + g]
