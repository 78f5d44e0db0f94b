"""Solutions by the factors of fronts, compiled. To be imported where it is used: it takes the
compiler along.

BLAS's product of matrices, to be called by compiled loops. To be imported where it is used: it
takes the compiler along.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import get_cython_function_address, intrinsic

from orchestrator.compiled import compiled, SUMS


# the one that scipy brings
PRODUCT = get_cython_function_address("scipy.linalg.cython_blas", "dgemm")
REAL = 8  # bytes of a number
loop = numba.njit(nogil=True, fastmath=SUMS)  # of what compiled loops call


@intrinsic
def gemm(typing, routine, shape, scales, a, b, c):
    """C ← α A B + β C of matrices that lie row after row, (m, k) by (k, n).

    routine : address of BLAS's; shape : m, n, k; scales : α and β
    a, b, c : address of the first entry, and entries from one row to the next
    """
    real, whole = scales.dtype, types.intp
    two = types.UniTuple(whole, 2)
    signature = types.void(whole, types.UniTuple(whole, 3), types.UniTuple(real, 2), two, two, two)

    def generate(context, builder, signature, arguments):
        routine, *tuples = arguments
        (m, n, k), (alpha, beta), (a, lda), (b, ldb), (c,
                                                       ldc) = (
                                                           cgutils.unpack_tuple(builder, x)
                                                           for x in tuples)
        real, word, letter = context.get_value_type(signature.args[2].dtype), ir.IntType(
            32), ir.IntType(8)

        def at(value, kind):
            place = cgutils.alloca_once(builder, kind)
            builder.store(value, place)
            return place

        def number(value):
            return at(builder.trunc(value, word), word)

        def matrix(address):
            return builder.inttoptr(address, real.as_pointer())

        # row after row is column after column of the transposed, and Cᵀ = Bᵀ Aᵀ
        given = [at(letter(ord("N")), letter), at(letter(ord("N")), letter), number(n), number(m),
                 number(k), at(alpha, real),
                 matrix(b), number(ldb), matrix(a), number(lda), at(beta, real), matrix(c),
                 number(ldc)]
        kind = ir.FunctionType(ir.VoidType(), [x.type for x in given])
        builder.call(builder.inttoptr(routine, kind.as_pointer()), given)
        return context.get_dummy_value()

    return signature, generate


@loop
def multiply(product, alpha, A, B, beta, C):
    """C ← α A B + β C of matrices whose rows lie together; ``product``: address of BLAS's."""
    gemm(product, (len(A), B.shape[1], len(B)), (alpha, beta),
         (np.int64(A.ctypes.data), A.strides[0] // REAL),
         (np.int64(B.ctypes.data), B.strides[0] // REAL),
         (np.int64(C.ctypes.data), C.strides[0] // REAL))


@loop
def columns_of(f, layout, own):
    """L of a front, what is in the columns that it eliminates."""
    (a, m), start = layout[1][f], layout[2][f, 0]
    return own[start : start + (a + m) * a].reshape(a + m, a)


@loop
def beside_of(f, layout, beside):
    """U of a front, what is beside these."""
    (a, m), start = layout[1][f], layout[2][f, 1]
    return beside[start : start + a * m].reshape(a, m)


@compiled
def forward(fronts, factors, x):
    """Eliminate from right-hand sides x (bodies, size), in the order of elimination, what is in
    fronts, one after the other.

    factors : ``layout``, ``own`` and ``beside`` as for ``eliminate``
    """
    layout, own_parts, _ = factors
    band, sizes, _, starts, _, _, _, _, rests, rest, _ = layout
    size, flat, z = x.shape[1], x.reshape(-1), np.empty(band)
    for f in fronts:
        (a, _), L = sizes[f], columns_of(f, layout, own_parts)
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
    band, sizes, _, starts, _, _, _, _, rests, rest, _ = layout
    size, flat = x.shape[1], x.reshape(-1)
    seen = np.empty(len(flat))
    for k in range(len(fronts) - 1, -1, -1):
        f = fronts[k]
        (a, m), L, U = sizes[f], columns_of(f, layout, own_parts), beside_of(f, layout, beside)
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


@loop
def _times_each(row, other):
    total = 0.0
    for j in range(len(row)):
        total += row[j] * other[j]
    return total
