"""Loops of the coarse contact problem over node pairs and blocks, compiled."""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled

BLOCK = 128  # columns of fields that stay in the first cache from one load step to the next: twelve fields of 1,024 do not


@compiled
def carried_along(start, stop, body, y, fields, at, result):
    """result (T, D) = at + y fields in columns from start to stop: each moves with the fields of its body.

    body : (D,) int, same ones together; y : (T, bodies, m); fields : (m, D)
    """
    a = start
    while a < stop:
        b = a + 1
        while b < stop and b < a + BLOCK and body[b] == body[a]:
            b += 1
        for t in range(len(at)):
            before, after, shares = at[t, a:b], result[t, a:b], y[t, body[a]]
            for i in range(len(before)):
                after[i] = before[i]
            for m in range(len(shares)):
                share, field = shares[m], fields[m, a:b]
                for i in range(len(field)):
                    after[i] += share * field[i]
        a = b


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
def moved(start, stop, phi, chosen, bounds, C, d):
    """d (3, Q) = (1₃ ⊗ φ) c at some of the pairs, for the combinations C (I, 3m) of the monomials; as for ``spread``."""
    m = phi.shape[1]
    for i in range(start, stop):
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            for c in range(3):
                total = 0.0
                for j in range(m):
                    total += C[i, c * m + j] * phi[p, j]
                d[c, q] = total


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
def along(start, stop, F, theta, dF, result):
    """result (3, Q) = F + θ dF at pairs from start to stop."""
    for c in range(3):
        here, change, there = F[c, start:stop], dF[c, start:stop], result[c, start:stop]
        for q in range(len(there)):
            there[q] = here[q] + theta * change[q]


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


@compiled
def gathered(ends, each, result):
    """result (bodies, n) += what each (I, 2, n) interface brings its two bodies ``ends`` (I, 2)."""
    for i in range(len(ends)):
        for side in range(2):
            for f in range(each.shape[2]):
                result[ends[i, side], f] += each[i, side, f]


@compiled
def added_up(start, stop, places, sign, blocks, at, result):
    """result (n, s) = at + sign · the sum of some blocks (k, s), in rows from start to stop.

    places : (n + 1,) int, where those of each row begin, and which they are
    """
    starts, which = places
    for i in range(start, stop):
        row, before = result[i], at[i]
        for j in range(len(row)):
            row[j] = before[j]
        for k in range(starts[i], starts[i + 1]):
            block = blocks[which[k]]
            for j in range(len(row)):
                row[j] += sign * block[j]
