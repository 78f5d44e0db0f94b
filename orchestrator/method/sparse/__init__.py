"""Direct solvers of sparse matrices, and what all of the method asks of them.

    symmetric.factorise(lower)(rows)
    blocks.BlockPattern(ends, bodies, size).factors(values, shift).solve(right)

The first solves with symmetric positive definite matrices, the second with blocks of bodies and of
pairs of bodies. Others are private to this folder.
"""
