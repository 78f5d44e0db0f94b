"""Loops of the coarse contact problem over node pairs and blocks, compiled."""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled

BLOCK = 1024  # columns of fields that stay in a core's own cache from one load step to the next


@compiled
def carried_along(start, stop, body, y, fields, at, result):
    """result (T, D) = at + y fields in columns from start to stop: each moves with the fields of its body.

    Parameters
    ----------
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
def spread(L, chosen, bounds, both, F):
    """F (3, Q) += L y at some of the pairs.

    Parameters
    ----------
    L : (P, 3, 24); chosen : (Q,) int, among these, interface after interface
    bounds : (I + 1,) int, where those of each interface start
    both : (I, 24) fields of the two bodies
    """
    for i in range(len(both)):
        y = both[i]
        for q in range(bounds[i], bounds[i + 1]):
            row = L[chosen[q]]
            for c in range(3):
                total = 0.0
                for f in range(len(y)):
                    total += row[c, f] * y[f]
                F[c, q] += total


@compiled
def moved(phi, chosen, bounds, C, d):
    """d (3, Q) = (1₃ ⊗ φ) c at some of the pairs, for the combinations C (I, 3m) of the monomials; as for ``spread``."""
    m = phi.shape[1]
    for i in range(len(C)):
        for q in range(bounds[i], bounds[i + 1]):
            p = chosen[q]
            for c in range(3):
                total = 0.0
                for j in range(m):
                    total += C[i, c * m + j] * phi[p, j]
                d[c, q] = total


@compiled
def carried(phi, chosen, bounds, A, ends, force, weight, result):
    """result (bodies, 12) += Aᵀ Σ ω f̂ ⊗ φ of forces (3, Q), first body and second body of each interface.

    Parameters
    ----------
    phi : (P, m); A : (I, 3m, 24); weight : (P,) ω
    ends : (I, 2) int, the two bodies
    others : as for ``spread``
    """
    m, half = phi.shape[1], A.shape[2] // 2
    moments = np.empty(3 * m)
    for i in range(len(ends)):
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
            for f in range(half):
                result[ends[i, 0], f] += A[i, a, f] * moments[a]
                result[ends[i, 1], f] += A[i, a, half + f] * moments[a]


@compiled
def slopes(phi, L, chosen, A, active, first, derivative, weight, result):
    """result (I, 2, 2, 12, 12) = Aᵀ Σ ω (∂f̂/∂F ⊗ φ) L, blocks of the two bodies.

    Parameters
    ----------
    active : (R,) int, ascending, among the chosen pairs; first : (I + 1,) int, where those of each interface start
    derivative : (3, 3, R)
    others : as for ``carried``
    """
    m, size = phi.shape[1], L.shape[2]
    half = size // 2
    sums, turned = np.empty((3 * m, size)), np.empty((3, size))
    for i in range(len(result)):
        result[i] = 0.0
        if first[i] == first[i + 1]:
            continue
        sums[:] = 0.0
        for r in range(first[i], first[i + 1]):
            p = chosen[active[r]]
            for c in range(3):
                a, b, d = derivative[c, 0, r], derivative[c, 1, r], derivative[c, 2, r]
                for f in range(size):
                    turned[c, f] = weight[p] * (a * L[p, 0, f] + b * L[p, 1, f] + d * L[p, 2, f])
            for c in range(3):
                for j in range(m):
                    for f in range(size):
                        sums[c * m + j, f] += phi[p, j] * turned[c, f]
        for row in range(2):
            for column in range(2):
                block = result[i, row, column]
                for a in range(3 * m):
                    for f in range(half):
                        for g in range(half):
                            block[f, g] += A[i, a, row * half + f] * sums[a, column * half + g]


@compiled
def add_blocks(blocks, chosen, rows, columns, own, A, B, C, D):
    """Add blocks (n, s, s) to a matrix [[A, B], [C, D]] whose first ``own`` block rows and columns are A's.

    Parameters
    ----------
    chosen : (k,) int, which; rows, columns : (k,) int, their place
    """
    s = blocks.shape[1]
    for k in range(len(chosen)):
        block, row, column = blocks[chosen[k]], rows[k], columns[k]
        upper, left = row < own, column < own
        target = (A if left else B) if upper else (C if left else D)
        i0, j0 = s * (row if upper else row - own), s * (column if left else column - own)
        for j in range(s):
            for i in range(s):
                target[i0 + i, j0 + j] += block[i, j]


@compiled
def add_matrix(left, within, size, own, A, B, C, D):
    """Add a matrix of blocks to [[A, B], [C, D]]; within : (m,) int, the place of its block rows and columns."""
    for v in range(len(within)):
        column = within[v]
        is_left = column < own
        j0 = size * (column if is_left else column - own)
        for u in range(len(within)):
            row = within[u]
            upper = row < own
            target = (A if is_left else B) if upper else (C if is_left else D)
            i0 = size * (row if upper else row - own)
            for j in range(size):
                for i in range(size):
                    target[i0 + i, j0 + j] += left[size * u + i, size * v + j]
