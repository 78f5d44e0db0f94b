"""ΣTᵀ (∂f̂/∂F) L over node pairs, compiled. To be imported where it is used: it takes the compiler along."""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled
from orchestrator.method.coarse.products import gemm

TOGETHER = 64  # pairs to a product: enough for it to be quick, and what it takes stays in a core's own cache


@compiled
def slopes(start, stop, product, of, given, weight, result):
    """result (I, 2, 2, n, n) = Aᵀ Σ ω (∂f̂/∂F ⊗ φ) L of the interfaces from start to stop, blocks of the two bodies.

    product : address of BLAS's product, in L's precision, that of all sums
    of : φ (P, m); L (P, 3, 2n); (Q,) int, pairs among these; A (I, 2n, 3m), transposed, in L's precision
    given : (R,) int, ascending, pairs among the chosen; (I + 1,) int, where those of each interface start; ∂f̂/∂F (3, 3, R)
    weight : (P,) ω
    """
    (phi, L, chosen, A), (active, first, derivative) = of, given
    m, size, real = phi.shape[1], L.shape[2], L.itemsize
    half, rows = size // 2, 3 * m
    turned, fields = np.empty((rows, 3 * TOGETHER), L.dtype), np.empty((3 * TOGETHER, size), L.dtype)
    sums, whole, share = np.empty((rows, size), L.dtype), np.empty((size, size), L.dtype), np.empty(TOGETHER)
    at_turned, at_fields = np.int64(turned.ctypes.data), np.int64(fields.ctypes.data)
    at_sums, at_whole, at_A = np.int64(sums.ctypes.data), np.int64(whole.ctypes.data), np.int64(A.ctypes.data)
    one, nothing = L.dtype.type(1.0), L.dtype.type(0.0)
    for i in range(start, stop):
        if first[i] == first[i + 1]:
            result[i] = 0.0
            continue
        sums[:] = nothing
        for r in range(first[i], first[i + 1], TOGETHER):
            count = min(TOGETHER, first[i + 1] - r)
            for q in range(count):
                p = chosen[active[r + q]]
                for d in range(3):
                    for f in range(size):
                        fields[count * d + q, f] = L[p, d, f]
            for j in range(m):
                for q in range(count):
                    p = chosen[active[r + q]]
                    share[q] = weight[p] * phi[p, j]
                for c in range(3):
                    for d in range(3):
                        row, slope = turned[c * m + j, count * d : count * d + count], derivative[c, d, r : r + count]
                        for q in range(count):
                            row[q] = share[q] * slope[q]
            gemm(product, (rows, size, 3 * count), one, (at_turned, 3 * TOGETHER), (at_fields, size), one, (at_sums, size))
        gemm(product, (size, size, rows), one, (at_A + real * size * rows * i, rows), (at_sums, size), nothing, (at_whole, size))
        for row in range(2):
            for column in range(2):
                for f in range(half):
                    for g in range(half):
                        result[i, row, column, f, g] = whole[row * half + f, column * half + g]
