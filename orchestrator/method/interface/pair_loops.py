"""Loops over node pairs, compiled: from traces to predicted forces, from what laws answer back to traces, and norms.

Shapes and formulas are those of ``point_traces`` and ``pairs``. Every loop is over the pairs from start to stop, see
``compiled.in_parts``, counted from zero in slices: what a loop need not look for at the end of an array is faster. ``free``
(3, P) tells the components that are not prescribed, and the others are zero.
"""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled


@compiled
def at_pairs(start, stop, one, two, free, w, f, jump, force):
    """Jump w₂ − w₁ and force ½(f₁ − f₂), (T, 3, P), of traces (T, D + G)."""
    part = slice(start, stop)
    jump, force = jump[:, :, part], force[:, :, part]
    one, two, free = one[:, part], two[:, part], free[:, part]
    for t in range(len(w)):
        for c in range(3):
            for p in range(stop - start):
                jump[t, c, p] = force[t, c, p] = 0.0
                if free[c, p]:
                    jump[t, c, p] = w[t, two[c, p]] - w[t, one[c, p]]
                    force[t, c, p] = 0.5 * (f[t, one[c, p]] - f[t, two[c, p]])


@compiled
def predicted(start, stop, free, normal, stiff_n, stiff_t, jump, force, F):
    """F = force + keq jump, (T, 3, P)."""
    part = slice(start, stop)
    jump, force, F = jump[:, :, part], force[:, :, part], F[:, :, part]
    free, normal = free[:, part], normal[:, part]
    stiff_n, stiff_t = stiff_n[part], stiff_t[part]
    for t in range(len(F)):
        for p in range(stop - start):
            along = 0.0
            for c in range(3):
                along += jump[t, c, p] * normal[c, p]
            along *= stiff_n[p] - stiff_t[p]
            for c in range(3):
                F[t, c, p] = 0.0
                if free[c, p]:
                    F[t, c, p] = force[t, c, p] + stiff_t[p] * jump[t, c, p] + along * normal[c, p]


@compiled
def resisted(start, stop, free, normal, stiff_n, stiff_t, F, previous, result):
    """result = F − keq d_before, (3, P)."""
    part = slice(start, stop)
    free, normal, F, previous, result = free[:, part], normal[:, part], F[:, part], previous[:, part], result[:, part]
    stiff_n, stiff_t = stiff_n[part], stiff_t[part]
    for p in range(stop - start):
        along = 0.0
        for c in range(3):
            along += previous[c, p] * normal[c, p]
        along *= stiff_n[p] - stiff_t[p]
        for c in range(3):
            result[c, p] = F[c, p] - stiff_t[p] * previous[c, p] - along * normal[c, p] if free[c, p] else 0.0


@compiled
def settled(start, stop, free, normal, stiff_n, stiff_t, epsilon, F, previous, lawful, force, jump):
    """f̂ = (1 − ε) law(F) + ε (F − keq d_before) and d = (F − f̂)/keq, (3, P); ``epsilon`` is empty where nothing is blended."""
    part = slice(start, stop)
    free, normal, F, previous = free[:, part], normal[:, part], F[:, part], previous[:, part]
    lawful, force, jump = lawful[:, part], force[:, part], jump[:, part]
    stiff_n, stiff_t, epsilon = stiff_n[part], stiff_t[part], epsilon[part]
    rest = np.empty(3)
    for p in range(stop - start):
        share, along = 0.0, 0.0
        if len(epsilon):
            share = epsilon[p]
            for c in range(3):
                along += previous[c, p] * normal[c, p]
            along *= stiff_n[p] - stiff_t[p]
        across = 0.0
        for c in range(3):
            force[c, p] = lawful[c, p]
            if share != 0.0:
                held = F[c, p] - stiff_t[p] * previous[c, p] - along * normal[c, p] if free[c, p] else 0.0
                force[c, p] += share * (held - lawful[c, p])
            rest[c] = F[c, p] - force[c, p]
            across += rest[c] * normal[c, p]
        across *= 1.0 / stiff_n[p] - 1.0 / stiff_t[p]
        for c in range(3):
            jump[c, p] = rest[c] / stiff_t[p] + across * normal[c, p] if free[c, p] else 0.0


@compiled
def hats(start, stop, one, two, free, size, normal, stiff_n, stiff_t, w, f, force, jump, w_hat, f_hat):
    """Write ŵ and f̂ (T, D) of both sides for f̂ and d (T, 3, P); ghosts, from ``size`` on, have none."""
    part = slice(start, stop)
    force, jump = force[:, :, part], jump[:, :, part]
    one, two, free, normal = one[:, part], two[:, part], free[:, part], normal[:, part]
    stiff_n, stiff_t = stiff_n[part], stiff_t[part]
    total = np.empty(3)
    for t in range(len(w)):
        for p in range(stop - start):
            along = 0.0
            for c in range(3):
                total[c] = f[t, one[c, p]] + f[t, two[c, p]] if free[c, p] else 0.0
                along += total[c] * normal[c, p]
            along *= 1.0 / stiff_n[p] - 1.0 / stiff_t[p]
            for c in range(3):
                if not free[c, p]:
                    continue
                a, b, d = one[c, p], two[c, p], jump[t, c, p]
                first = 0.5 * (w[t, a] + w[t, b] - d) - (total[c] / stiff_t[p] + along * normal[c, p]) / 4.0
                if a < size:
                    w_hat[t, a], f_hat[t, a] = first, force[t, c, p]
                if b < size:
                    w_hat[t, b], f_hat[t, b] = first + d, -force[t, c, p]


@compiled
def squares(start, stop, one, two, free, mine, normal, stiff_n, stiff_t, f, force):
    """Sums of x · x/keq over the pairs that are ``mine``: of f₁ − f̂ and f₂ + f̂, of f₁ and f₂, of f₁ + f₂."""
    part = slice(start, stop)
    force = force[:, :, part]
    one, two, free, normal = one[:, part], two[:, part], free[:, part], normal[:, part]
    mine, stiff_n, stiff_t = mine[part], stiff_n[part], stiff_t[part]
    apart, whole, unbalanced = 0.0, 0.0, 0.0
    for t in range(len(f)):
        for p in range(stop - start):
            if not mine[p]:
                continue
            a1, a2, n1, n2, n3, n4, n5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            a3 = 0.0
            for c in range(3):
                if not free[c, p]:
                    continue
                f1, f2, given, n = f[t, one[c, p]], f[t, two[c, p]], force[t, c, p], normal[c, p]
                a1 += (f1 - given) * (f1 - given) + (f2 + given) * (f2 + given)
                a2 += f1 * f1 + f2 * f2
                a3 += (f1 + f2) * (f1 + f2)
                n1 += (f1 - given) * n
                n2 += (f2 + given) * n
                n3 += f1 * n
                n4 += f2 * n
                n5 += (f1 + f2) * n
            tangential, normally = 1.0 / stiff_t[p], 1.0 / stiff_n[p] - 1.0 / stiff_t[p]
            apart += tangential * a1 + normally * (n1 * n1 + n2 * n2)
            whole += tangential * a2 + normally * (n3 * n3 + n4 * n4)
            unbalanced += tangential * a3 + normally * n5 * n5
    return apart, whole, unbalanced


@compiled
def largest_tractions(start, stop, area, force, lawful):
    """The largest |f̂ − law(F)| / A and |law(F)| / A of forces (T, 3, P); nan if any is."""
    part = slice(start, stop)
    force, lawful = force[:, :, part], lawful[:, :, part]
    area = area[part]
    springs, carried = 0.0, 0.0
    for t in range(len(force)):
        for p in range(stop - start):
            a, b = 0.0, 0.0
            for c in range(3):
                a += (force[t, c, p] - lawful[t, c, p]) ** 2
                b += lawful[t, c, p] ** 2
            a, b = np.sqrt(a) / area[p], np.sqrt(b) / area[p]
            if a > springs or a != a:
                springs = a
            if b > carried or b != b:
                carried = b
    return springs, carried
