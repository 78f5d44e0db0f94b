"""Elimination of fronts and solutions by their factors, compiled; ``elimination`` says what a front is.

A front's matrix is eliminated panel after panel. With P the panel's own square, inverted, L below it and R beside it:

    [[P, R], [L, S]]  →  R ← P⁻¹ R,   S ← S − L R

so that all but the inverses are products of BLAS, which is several times as quick at these sizes as LAPACK's triangular
solutions are. What is below and right of a band of panels is changed once for all of them. Pivots are sought within P. To be imported where it is used: it takes the compiler along.
"""

from __future__ import annotations

import numba
import numpy as np

from orchestrator.compiled import SUMS, compiled
from orchestrator.method.coarse.products import gemm

WIDE = 8  # panels of a band: products of matrices that no core's cache holds are as quick as others


@numba.njit(nogil=True, fastmath=SUMS)
def _inverted(P, turn):
    """Replace a square by its inverse (Gauss and Jordan, rows exchanged); False if a pivot vanishes."""
    n = len(P)
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(P[i, k]) > abs(P[best, k]):
                best = i
        pivot = P[best, k]
        if not abs(pivot) > 0.0:
            return False
        turn[k] = best
        if best != k:
            for j in range(n):
                P[k, j], P[best, j] = P[best, j], P[k, j]
        P[k, k] = P.dtype.type(1.0)
        above = P[k]
        for j in range(n):
            above[j] = above[j] / pivot
        for i in range(n):
            if i != k:
                row = P[i]
                share = row[k]
                row[k] = P.dtype.type(0.0)
                for j in range(n):
                    row[j] -= share * above[j]
    for k in range(n - 1, -1, -1):
        other = turn[k]
        if other != k:
            for i in range(n):
                P[i, k], P[i, other] = P[i, other], P[i, k]
    return True


@compiled
def eliminate(which, product, constants, blocks, panel, sizes, places, enters, enter, children, child, withins, within,
              own_parts, beside, work):
    """Eliminate some of the fronts; −1, or the number of one whose pivot vanishes.

    Parameters
    ----------
    which : (n,) int, the fronts, children before parents
    product : address of BLAS's product; constants : (3,) −1, 0 and 1, of the factors' precision
    blocks : (b, size, size) of the matrix; panel : rows of a panel
    sizes : (F, 2) int, rows that are eliminated, rows that are left
    places : (F, 3) int, where a front begins in ``own_parts``, ``beside`` and ``work``
    enters : (F + 1,) int, where blocks that enter begin in ``enter`` (k, 3) int: which, and its block row and column
    children : (F + 1,) int, where its children begin in ``child``; withins : the same for places in the parent, ``within``
    own_parts, beside : take the columns of what is eliminated, and what is beside; work : (·,) takes whole fronts
    """
    size, minus, nothing, one = blocks.shape[1], constants[0], constants[1], constants[2]
    bytes_of, turn = work.itemsize, np.empty(panel, np.int64)
    runs = np.empty((len(within), 3), np.int64)
    for f in which:
        a, n = sizes[f, 0], sizes[f, 0] + sizes[f, 1]
        F = work[places[f, 2] : places[f, 2] + n * n].reshape(n, n)
        for i in range(n):
            for j in range(n):
                F[i, j] = nothing
        for k in range(enters[f], enters[f + 1]):
            b, i0, j0 = enter[k, 0], size * enter[k, 1], size * enter[k, 2]
            for i in range(size):
                for j in range(size):
                    F[i0 + i, j0 + j] += blocks[b, i, j]
        for k in range(children[f], children[f + 1]):
            c = child[k]
            a_c, n_c, first = sizes[c, 0], sizes[c, 0] + sizes[c, 1], withins[c]
            given = work[places[c, 2] : places[c, 2] + n_c * n_c].reshape(n_c, n_c)
            count = 0  # runs of neighbours in the parent
            for v in range(withins[c + 1] - first):
                if v and within[first + v] == within[first + v - 1] + 1:
                    runs[count - 1, 2] += size
                else:
                    runs[count, 0], runs[count, 1], runs[count, 2] = size * within[first + v], a_c + size * v, size
                    count += 1
            for i in range(a_c, n_c):
                u, r = divmod(i - a_c, size)
                row, of = F[size * within[first + u] + r], given[i]
                for v in range(count):
                    j0, j1 = runs[v, 0], runs[v, 1]
                    for j in range(runs[v, 2]):
                        row[j0 + j] += of[j1 + j]
        at, scratch = np.int64(F.ctypes.data), np.empty(panel * n, work.dtype)
        at_scratch = np.int64(scratch.ctypes.data)
        for first in range(0, a, WIDE * panel):
            last = min(first + WIDE * panel, a)
            for p in range(first, last, panel):
                q = min(p + panel, last)
                if not _inverted(F[p:q, p:q], turn):
                    return f
                w, rest = q - p, n - q
                if not rest:
                    continue
                for i in range(w):
                    for j in range(rest):
                        scratch[i * rest + j] = F[p + i, q + j]
                right, below = at + bytes_of * (n * p + q), at + bytes_of * (n * q + p)
                gemm(product, w, rest, w, one, at + bytes_of * (n * p + p), n, at_scratch, rest, nothing, right, n)
                if q < last:  # rows of this band, then what is below it in its columns
                    gemm(product, last - q, rest, w, minus, below, n, right, n, one, at + bytes_of * (n * q + q), n)
                    gemm(product, n - last, last - q, w, minus, at + bytes_of * (n * last + p), n, right, n, one,
                         at + bytes_of * (n * last + q), n)
            if last < n:
                gemm(product, n - last, n - last, last - first, minus, at + bytes_of * (n * last + first), n,
                     at + bytes_of * (n * first + last), n, one, at + bytes_of * (n * last + last), n)
        L = own_parts[places[f, 0] : places[f, 0] + n * a].reshape(n, a)
        for i in range(n):
            for j in range(a):
                L[i, j] = F[i, j]
        U = beside[places[f, 1] : places[f, 1] + a * (n - a)].reshape(a, n - a)
        for i in range(a):
            for j in range(n - a):
                U[i, j] = F[i, a + j]
    return -1


@numba.njit(nogil=True, fastmath=SUMS)
def _solved(factors, right, result):
    """See ``solve``."""
    panel, order, sizes, places, starts, rests, rest, own_parts, beside = factors
    size, x = right.shape[1], np.empty(right.shape, own_parts.dtype)
    for i in range(len(order)):
        for c in range(size):
            x[i, c] = right[order[i], c]
    flat = x.reshape(-1)
    seen, z = np.empty(len(flat), x.dtype), np.empty(panel, x.dtype)
    for f in range(len(sizes)):
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + (a + m) * a].reshape(a + m, a)
        own = flat[size * starts[f] : size * starts[f] + a]
        for p in range(0, a, panel):
            q = min(p + panel, a)
            for i in range(p, q):
                total, row = x.dtype.type(0.0), L[i, p:q]
                for j in range(len(row)):
                    total += row[j] * own[p + j]
                z[i - p] = total
            for i in range(p, q):
                own[i] = z[i - p]
            for i in range(q, a):
                total, row = x.dtype.type(0.0), L[i, p:q]
                for j in range(len(row)):
                    total += row[j] * z[j]
                own[i] -= total
        i = a
        for u in range(rests[f], rests[f + 1]):
            other = x[rest[u]]
            for c in range(size):
                total, row = x.dtype.type(0.0), L[i]
                for j in range(a):
                    total += row[j] * own[j]
                other[c] -= total
                i += 1
    for f in range(len(sizes) - 1, -1, -1):
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + a * a].reshape(a, a)
        U = beside[places[f, 1] : places[f, 1] + a * m].reshape(a, m)
        own, others = flat[size * starts[f] : size * starts[f] + a], seen[:m]
        for u in range(rests[f], rests[f + 1]):
            for c in range(size):
                others[size * (u - rests[f]) + c] = x[rest[u], c]
        for i in range(a):
            total, row = x.dtype.type(0.0), U[i]
            for j in range(m):
                total += row[j] * others[j]
            own[i] -= total
        for p in range((a - 1) // panel * panel, -1, -panel):
            q = min(p + panel, a)
            for i in range(p, q):
                total, row = x.dtype.type(0.0), L[i, q:]
                for j in range(len(row)):
                    total += row[j] * own[q + j]
                own[i] -= total
    for i in range(len(order)):
        for c in range(size):
            result[order[i], c] = x[i, c]


@compiled
def solve(factors, right, result):
    """Write the solution (bodies, size) for a right-hand side.

    Parameters
    ----------
    factors : rows of a panel; (bodies,) int, the order of elimination; ``sizes`` and ``places`` as for ``eliminate``; (F,) int,
        the first body of each front; (F + 1,) int, where the bodies that it leaves begin in the next; ``own_parts``, ``beside``
    """
    _solved(factors, right, result)


@numba.njit(nogil=True, fastmath=SUMS)
def _times(blocks, starts, columns, x, result):
    """result (bodies, size) = a matrix of blocks (n, size, size), row after row, times x."""
    size = blocks.shape[1]
    for i in range(len(result)):
        total = result[i]
        total[:] = 0.0
        for k in range(starts[i], starts[i + 1]):
            block, part = blocks[k], x[columns[k]]
            for c in range(size):
                one, row = 0.0, block[c]
                for d in range(size):
                    one += row[d] * part[d]
                total[c] += one


@compiled
def gmres(factors, blocks, starts, columns, right, most, accuracy, seen, x, more):
    """Solve with a matrix of blocks (n, size, size), its rows' ``starts`` and ``columns``, preconditioned from the right.

    Parameters
    ----------
    factors : as for ``solve``, of a matrix like it
    right : (bodies, size)
    most : products that are allowed; accuracy : relative residual that is asked for
    seen : products after which it can be told how many more it takes
    x, more : (bodies, size) take the solution, and what the factors make of the residual that it leaves

    Returns
    -------
    bool : whether it is solved
    """
    shape, length = right.shape, np.sqrt((right**2).sum())
    x[:], more[:] = 0.0, 0.0
    if length == 0.0:
        return True
    basis, directions = np.empty((most + 1, *shape)), np.empty((most, *shape))
    R, turn, target = np.zeros((most + 1, most)), np.zeros((most, 2)), np.zeros(most + 1)
    basis[0], target[0], count = right / length, 1.0, 0
    for j in range(most):
        _solved(factors, basis[j], directions[j])
        new = basis[j + 1]
        _times(blocks, starts, columns, directions[j], new)
        for _ in range(2):  # what rounding leaves of a direction that is nearly known
            for i in range(j + 1):
                part = (basis[i] * new).sum()
                new -= part * basis[i]
                R[i, j] += part
        height = np.sqrt((new**2).sum())
        if not np.isfinite(height):
            return False
        for i in range(j):  # Givens's rotations make it triangular
            a, b = R[i, j], R[i + 1, j]
            R[i, j], R[i + 1, j] = turn[i, 0] * a + turn[i, 1] * b, turn[i, 0] * b - turn[i, 1] * a
        far = np.hypot(R[j, j], height)
        if far == 0.0:
            return False
        turn[j, 0], turn[j, 1] = R[j, j] / far, height / far
        R[j, j], target[j], target[j + 1] = far, turn[j, 0] * target[j], -turn[j, 1] * target[j]
        left = abs(target[j + 1])
        if left <= accuracy:
            count = j + 1
            break
        if height == 0.0 or (j + 1 >= seen and left ** (most / (j + 1)) > accuracy):
            return False
        new /= height
    if count == 0:
        return False
    for i in range(count - 1, -1, -1):
        share = target[i]
        for j in range(i + 1, count):
            share -= R[i, j] * target[j]
        target[i] = share / R[i, i]
        x += (length * target[i]) * directions[i]
    _times(blocks, starts, columns, x, basis[0])
    _solved(factors, right - basis[0], more)
    return True
