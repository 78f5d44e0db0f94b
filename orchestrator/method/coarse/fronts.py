"""Elimination of fronts and solutions by their factors, compiled; ``elimination`` says what a front is.

A front lies in three pieces, L what is in the columns that it eliminates, U what is beside these, S what is left. L and U are
eliminated band after band. With P a band's own square, inverted, C below it and R beside it:

    R ← P⁻¹ R,   what is below and beside ← that − C R,     S ← −(C of all bands) U + what the children leave

so that all but the inverses of small squares are products of BLAS, which is several times as quick at these sizes as LAPACK is,
and every number is touched as seldom as can be: what takes time beside the products is to bring numbers to the cores.
P is inverted by Gauss and Jordan's method, panel after panel; pivots are sought within a panel. To be imported where it is used:
it takes the compiler along.
"""

from __future__ import annotations

import numba
import numpy as np

from orchestrator.compiled import SUMS, compiled
from orchestrator.method.coarse.products import gemm


LANES = 16  # numbers that a core works on at once: loops over so many become one instruction


@numba.njit(nogil=True, fastmath=SUMS)
def _inverted(P, turn):
    """Replace a square, whose rows are filled up with zeros to whole ``LANES``, by its inverse (Gauss and Jordan, rows exchanged);
    False if a pivot vanishes."""
    n, width = P.shape
    for k in range(n):
        best, largest = k, abs(P[k, k])
        for i in range(k + 1, n):
            if abs(P[i, k]) > largest:
                best, largest = i, abs(P[i, k])
        if not largest > 0.0:
            return False
        turn[k] = best
        above = P[k]
        if best != k:
            other = P[best]
            for s in range(0, width, LANES):
                for j in range(s, s + LANES):
                    above[j], other[j] = other[j], above[j]
        share = P.dtype.type(1.0) / above[k]
        above[k] = P.dtype.type(1.0)
        for s in range(0, width, LANES):
            for j in range(s, s + LANES):
                above[j] *= share
        for i in range(n):
            if i != k:
                row = P[i]
                share = row[k]
                row[k] = P.dtype.type(0.0)
                for s in range(0, width, LANES):
                    for j in range(s, s + LANES):
                        row[j] -= share * above[j]
    for k in range(n - 1, -1, -1):
        other = turn[k]
        if other != k:
            for i in range(n):
                P[i, k], P[i, other] = P[i, other], P[i, k]
    return True


@numba.njit(nogil=True, fastmath=SUMS)
def _inverted_by_panels(P, panel, product, constants):
    """The same for a larger one, panel after panel: with D a panel's inverse, its rows become D·P, all others less their part of
    the panel's columns times these."""
    n, minus, nothing, one = len(P), constants[0], constants[1], constants[2]
    width = (panel + LANES - 1) // LANES * LANES
    turn, square = np.empty(panel, np.int64), np.zeros((panel, width), P.dtype)
    beside, below = np.empty(2 * n * panel, P.dtype), np.empty(n * panel, P.dtype)
    at_P, at_square, at_below = np.int64(P.ctypes.data), np.int64(square.ctypes.data), np.int64(below.ctypes.data)
    at_beside = np.int64(beside.ctypes.data)
    at_rows = at_beside + P.itemsize * n * panel
    for p in range(0, n, panel):
        q = min(p + panel, n)
        w = q - p
        D = square[:w]
        for i in range(w):
            for j in range(width):
                D[i, j] = P[p + i, p + j] if j < w else nothing
        if not _inverted(D, turn):
            return False
        for i in range(n):
            row, kept = P[i], below[i * w : (i + 1) * w]
            for j in range(w):
                kept[j] = row[p + j]
                row[p + j] = nothing
        for i in range(w):
            row, kept = P[p + i], beside[i * n : (i + 1) * n]
            P[p + i, p + i] = one
            for j in range(n):
                kept[j] = row[j]
                row[j] = nothing
            for j in range(w):
                below[(p + i) * w + j] = minus if i == j else nothing
        gemm(product, w, n, w, one, at_square, width, at_beside, n, nothing, at_rows, n)
        gemm(product, n, n, w, minus, at_below, w, at_rows, n, one, at_P, n)
    return True


WHOLE, ENTERED, ACROSS, BELOW, LEFT = range(-1, 4)  # what ``eliminate`` does


@compiled
def eliminate(start, stop, stage, which, at_row, shares, given, right):
    """Eliminate some of the fronts, or do a part of what there is to be done for one: −1, or the number of one whose pivot vanishes.

    Parameters
    ----------
    stage : ``WHOLE``: all that follows, for the fronts ``which[start:stop]``, children before parents; of the front
        ``which[0]``: ``ENTERED``: what enters is added up; ``ACROSS``: the band from ``at_row`` on is inverted, what is beside it
        multiplied; ``BELOW``: what is below that band less what it changes, in rows from start to stop, which count from the
        band's end; ``LEFT``: what is left, in rows from start to stop
    shares : (F, 2) int, at most so many rows below a band, and of what is left, are done as one, by whoever it be: products
        depend on it, to the last bit
    given : product: address of BLAS's product
        constants: (3,) −1, 0 and 1, of the factors' precision
        blocks: (b, size, size) of the matrix
        panel, band: their rows
        sizes: (F, 2) int, rows that are eliminated, rows that are left
        places: (F, 3) int, where a front begins in ``own_parts``, ``beside`` and ``work``
        enters: (F + 1,) int, where blocks that enter begin in ``enter`` (k, 3) int: which, and its block row and column
        children: (F + 1,) int, where its children begin in ``child``; withins: the same for places in the parent, ``within``
        own_parts, beside: take L and U; work: (·,) takes S
    right : (·,) takes U before it is multiplied, and behind it rows of a band as long as what is eliminated
    """
    if stage == ENTERED:
        _entered(which[0], given, right)
    elif stage == ACROSS:
        if not _across(which[0], at_row, given, right):
            return which[0]
    elif stage == BELOW:
        _below(which[0], at_row, start, stop, given, right)
    elif stage == LEFT:
        _left(which[0], start, stop, given)
    else:
        sizes, band = given[5], given[4]
        for k in range(start, stop):
            f = which[k]
            a, m = sizes[f]
            _entered(f, given, right)
            for p in range(0, a, band):
                if not _across(f, p, given, right):
                    return f
                rows = a + m - min(p + band, a)
                for i in range(0, rows, shares[f, 0]):
                    _below(f, p, i, min(i + shares[f, 0], rows), given, right)
            for i in range(0, m, max(1, shares[f, 1])):
                _left(f, i, min(i + shares[f, 1], m), given)
    return -1


@numba.njit(nogil=True, fastmath=SUMS)
def _entered(f, given, right):
    """What enters a front: blocks of the matrix, and what its children leave in the rows and columns that it eliminates."""
    _, constants, blocks, _, _, sizes, places, enters, enter, children, child, withins, within, own_parts, _, work = given
    size, nothing, (a, m) = blocks.shape[1], constants[1], sizes[f]
    L = own_parts[places[f, 0] : places[f, 0] + (a + m) * a].reshape(a + m, a)
    R, runs = right[: a * m].reshape(a, m), np.empty((len(within), 3), np.int64)
    for flat in (own_parts[places[f, 0] : places[f, 0] + (a + m) * a], right[: a * m]):
        for i in range(len(flat)):
            flat[i] = nothing
    for k in range(enters[f], enters[f + 1]):
        b, i0, j0 = enter[k, 0], size * enter[k, 1], size * enter[k, 2]
        for i in range(size):
            for j in range(size):
                if j0 < a:
                    L[i0 + i, j0 + j] += blocks[b, i, j]
                else:
                    R[i0 + i, j0 - a + j] += blocks[b, i, j]
    for k in range(children[f], children[f + 1]):
        c = child[k]
        m_c, first = sizes[c, 1], withins[c]
        split, count = _runs(within[first : withins[c + 1]], size, a, runs)
        for u in range(m_c // size):
            for r in range(size):
                to, of = size * within[first + u] + r, places[c, 2] + m_c * (size * u + r)
                _added(own_parts, places[f, 0] + a * to, work, of, runs, 0, split)
                if to < a:
                    _added(right, m * to, work, of, runs, split, count)


@numba.njit(nogil=True, fastmath=SUMS)
def _across(f, p, given, right):
    """A band's square is inverted, and what is beside it multiplied by that; False if a pivot vanishes."""
    product, constants, _, panel, band, sizes, places, _, _, _, _, _, _, own_parts, beside, work = given
    nothing, one, bytes_of, (a, m) = constants[1], constants[2], work.itemsize, sizes[f]
    L = own_parts[places[f, 0] : places[f, 0] + (a + m) * a].reshape(a + m, a)
    U = beside[places[f, 1] : places[f, 1] + a * m]
    q = min(p + band, a)
    w, rest = q - p, a - q
    P = right[a * m : a * m + w * w].reshape(w, w)  # what is made here may be gone before its address has been used
    _copied(L[p:q, p:q], P)
    if not _inverted_by_panels(P, panel, product, constants):
        return False
    _copied(P, L[p:q, p:q])
    at_P = np.int64(P.ctypes.data)
    if m:
        gemm(product, w, m, w, one, at_P, w, np.int64(right.ctypes.data) + bytes_of * m * p, m, nothing,
             np.int64(U.ctypes.data) + bytes_of * m * p, m)
    if rest:
        others = right[a * m + w * w : a * m + w * w + w * rest].reshape(w, rest)
        _copied(L[p:q, q:], others)
        gemm(product, w, rest, w, one, at_P, w, np.int64(others.ctypes.data), rest, nothing,
             np.int64(L.ctypes.data) + bytes_of * (a * p + q), a)
    return True


@numba.njit(nogil=True, fastmath=SUMS)
def _below(f, p, start, stop, given, right):
    """Some rows below a band, less what it changes in the columns that are still to be eliminated, and beside them."""
    product, constants, _, _, band, sizes, places, _, _, _, _, _, _, own_parts, beside, work = given
    minus, one, bytes_of, (a, m) = constants[0], constants[2], work.itemsize, sizes[f]
    q = min(p + band, a)
    w, rest = q - p, a - q
    if not rest:
        return
    at_L = np.int64(own_parts.ctypes.data) + bytes_of * places[f, 0]
    at_rows = at_L + bytes_of * a * (q + start)
    gemm(product, stop - start, rest, w, minus, at_rows + bytes_of * p, a, at_L + bytes_of * (a * p + q), a, one,
         at_rows + bytes_of * q, a)
    eliminated = min(stop, rest) - start
    if m and eliminated > 0:
        gemm(product, eliminated, m, w, minus, at_rows + bytes_of * p, a,
             np.int64(beside.ctypes.data) + bytes_of * (places[f, 1] + m * p), m, one,
             np.int64(right.ctypes.data) + bytes_of * m * (q + start), m)


@numba.njit(nogil=True, fastmath=SUMS)
def _left(f, start, stop, given):
    """Some rows of what is left."""
    product, constants, blocks, _, _, sizes, places, _, _, children, child, withins, within, own_parts, beside, work = given
    size, minus, nothing, bytes_of, (a, m) = blocks.shape[1], constants[0], constants[1], work.itemsize, sizes[f]
    runs, at_S = np.empty((len(within), 3), np.int64), np.int64(work.ctypes.data) + bytes_of * places[f, 2]
    gemm(product, stop - start, m, a, minus, np.int64(own_parts.ctypes.data) + bytes_of * (places[f, 0] + a * (a + start)), a,
         np.int64(beside.ctypes.data) + bytes_of * places[f, 1], m, nothing, at_S + bytes_of * m * start, m)
    for k in range(children[f], children[f + 1]):
        c = child[k]
        m_c, first = sizes[c, 1], withins[c]
        split, count = _runs(within[first : withins[c + 1]], size, a, runs)
        for u in range(m_c // size):
            for r in range(size):
                to = size * within[first + u] + r - a
                if start <= to < stop:
                    _added(work, places[f, 2] + m * to, work, places[c, 2] + m_c * (size * u + r), runs, split, count)


@numba.njit(nogil=True, fastmath=SUMS)
def _copied(given, result):
    """result = given, row after row: numba's own is slow."""
    for i in range(len(given)):
        row, of = result[i], given[i]
        for j in range(len(row)):
            row[j] = of[j]


@numba.njit(nogil=True, fastmath=SUMS)
def _runs(within, size, own, runs):
    """Runs of neighbours in the parent: where to, where from, how long. What is eliminated there comes first, the rest counts
    from its own first row. How many of the first, and of all."""
    split, count = 0, 0
    for v in range(len(within)):
        to = size * within[v]
        if v and within[v] == within[v - 1] + 1 and to != own:
            runs[count - 1, 2] += size
        else:
            runs[count, 0], runs[count, 1], runs[count, 2] = to if to < own else to - own, size * v, size
            count += 1
        if to < own:
            split = count
    return split, count


@numba.njit(nogil=True, fastmath=SUMS)
def _added(result, to, given, of, runs, first, last):
    """result += given, run after run, from where ``to`` and ``of`` are on. A view of each would take longer than what is done on it,
    and indices without a sign are never counted from the end."""
    for v in range(first, last):
        a, b, length = np.uint64(to + runs[v, 0]), np.uint64(of + runs[v, 1]), np.uint64(runs[v, 2])
        for j in range(length):
            result[a + j] += given[b + j]


@numba.njit(nogil=True, fastmath=SUMS)
def _solved(factors, right, result):
    """See ``solve``."""
    band, order, sizes, places, starts, rests, rest, own_parts, beside = factors
    size, x = right.shape[1], np.empty(right.shape, own_parts.dtype)
    for i in range(len(order)):
        for c in range(size):
            x[i, c] = right[order[i], c]
    flat = x.reshape(-1)
    seen, z = np.empty(len(flat), x.dtype), np.empty(band, x.dtype)
    for f in range(len(sizes)):
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + (a + m) * a].reshape(a + m, a)
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
    for f in range(len(sizes) - 1, -1, -1):
        a, m = sizes[f]
        L = own_parts[places[f, 0] : places[f, 0] + a * a].reshape(a, a)
        U = beside[places[f, 1] : places[f, 1] + a * m].reshape(a, m)
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
    for i in range(len(order)):
        for c in range(size):
            result[order[i], c] = x[i, c]


@numba.njit(nogil=True, fastmath=SUMS, inline="always")
def _times_each(row, other):
    total = row.dtype.type(0.0)
    for j in range(len(row)):
        total += row[j] * other[j]
    return total


@compiled
def solve(factors, right, result):
    """Write the solution (bodies, size) for a right-hand side.

    Parameters
    ----------
    factors : rows of a band; (bodies,) int, the order of elimination; ``sizes`` and ``places`` as for ``eliminate``; (F,) int,
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
def times(blocks, starts, columns, x, result):
    """result (bodies, size) = a matrix of blocks (n, size, size), its rows' ``starts`` and ``columns``, times x."""
    _times(blocks, starts, columns, x, result)


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
