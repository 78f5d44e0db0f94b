"""Loops of the coarse contact problem over node pairs and blocks, compiled."""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled


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
def swept(start, stop, of, ends, fields, weight, results):
    """dF = L y and ω (1₃ ⊗ φ) A y, the ``results`` (3, Q), at some of the pairs; as for ``spread`` and ``carried``.

    ends : (I, 2) int, the two bodies of each interface; fields : (bodies, n), of which y are those of the two
    """
    (L, phi, A, chosen, bounds), (dF, against) = of, results
    m, half = phi.shape[1], fields.shape[1]
    y, combined = np.empty(2 * half), np.empty(3 * m)
    for i in range(start, stop):
        if bounds[i] == bounds[i + 1]:
            continue
        for f in range(half):
            y[f], y[half + f] = fields[ends[i, 0], f], fields[ends[i, 1], f]
        for a in range(3 * m):
            total, of = 0.0, A[i, a]
            for f in range(len(y)):
                total += of[f] * y[f]
            combined[a] = total
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            row, monomials, share = L[p], phi[p], weight[p]
            for d in range(3):
                total = 0.0
                for f in range(len(y)):
                    total += row[d, f] * y[f]
                dF[d, q] = total
                total = 0.0
                for j in range(m):
                    total += combined[d * m + j] * monomials[j]
                against[d, q] = share * total


@compiled
def carried(start, stop, of, force, weight, result):
    """result (I, 2, n) = Aᵀ Σ ω f̂ ⊗ φ of forces (3, Q), first body and second body of each interface.

    of : L, φ (P, m), A (I, 3m, 2n), chosen and bounds, as for ``spread``; weight : (P,) ω
    """
    _, phi, A, chosen, bounds = of
    m, half = phi.shape[1], A.shape[2] // 2
    moments = np.empty(3 * m)
    for i in range(start, stop):
        result[i] = 0.0
        if bounds[i] == bounds[i + 1]:
            continue
        moments[:] = 0.0
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            for c in range(3):
                if force[c, q] != 0.0:
                    share = weight[p] * force[c, q]
                    for j in range(m):
                        moments[c * m + j] += share * phi[p, j]
        for a in range(3 * m):
            for side in range(2):
                for f in range(half):
                    result[i, side, f] += A[i, a, half * side + f] * moments[a]

