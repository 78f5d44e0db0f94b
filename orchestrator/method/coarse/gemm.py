"""BLAS's product of matrices, to be called by compiled loops. To be imported where it is used: it takes the compiler along."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import get_cython_function_address, intrinsic

PRODUCT = get_cython_function_address("scipy.linalg.cython_blas", "dgemm")  # the one that scipy brings
REAL = 8  # bytes of a number


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
