"""BLAS's product of matrices in compiled functions, and ΣTᵀ (∂f̂/∂F) L over node pairs by it.

To be imported where it is used: it takes the compiler along.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import get_cython_function_address, intrinsic

from orchestrator.compiled import compiled

# Addresses of the products that scipy brings.
PRODUCT = {np.dtype(np.float32): get_cython_function_address("scipy.linalg.cython_blas", "sgemm"),
           np.dtype(np.float64): get_cython_function_address("scipy.linalg.cython_blas", "dgemm")}
TOGETHER = 64  # pairs to a product: enough for it to be quick, and what it takes stays in a core's own cache


@intrinsic
def gemm(typing, routine, shape, scales, a, b, c):
    """C ← α A B + β C of matrices that lie row after row, (m, k) by (k, n).

    routine : address of BLAS's; shape : m, n, k; scales : α and β, of the precision that it works in
    a, b, c : address of the first entry, and entries from one row to the next
    """
    real, whole = scales.dtype, types.intp
    two = types.UniTuple(whole, 2)
    signature = types.void(whole, types.UniTuple(whole, 3), types.UniTuple(real, 2), two, two, two)

    def generate(context, builder, signature, arguments):
        routine, *tuples = arguments
        (m, n, k), (alpha, beta), (a, lda), (b, ldb), (c, ldc) = (cgutils.unpack_tuple(builder, x) for x in tuples)
        real, word, letter = context.get_value_type(signature.args[2].dtype), ir.IntType(32), ir.IntType(8)

        def at(value, kind):
            place = cgutils.alloca_once(builder, kind)
            builder.store(value, place)
            return place

        def number(value):
            return at(builder.trunc(value, word), word)

        def matrix(address):
            return builder.inttoptr(address, real.as_pointer())

        # row after row is column after column of the transposed, and Cᵀ = Bᵀ Aᵀ
        given = [at(letter(ord("N")), letter), at(letter(ord("N")), letter), number(n), number(m), number(k), at(alpha, real),
                 matrix(b), number(ldb), matrix(a), number(lda), at(beta, real), matrix(c), number(ldc)]
        kind = ir.FunctionType(ir.VoidType(), [x.type for x in given])
        builder.call(builder.inttoptr(routine, kind.as_pointer()), given)
        return context.get_dummy_value()

    return signature, generate


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
            gemm(product, (rows, size, 3 * count), (one, one), (at_turned, 3 * TOGETHER), (at_fields, size), (at_sums, size))
        gemm(product, (size, size, rows), (one, nothing), (at_A + real * size * rows * i, rows), (at_sums, size), (at_whole, size))
        for row in range(2):
            for column in range(2):
                for f in range(half):
                    for g in range(half):
                        result[i, row, column, f, g] = whole[row * half + f, column * half + g]
