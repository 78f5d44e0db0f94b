"""Elimination of fronts, compiled; ``elimination`` says what a front is, ``front_solves`` solves by
their factors.

A front lies in three pieces, L what is in the columns that it eliminates, U what is beside these, S
what is left. L and U are eliminated band after band. With P a band's own square, inverted, C below
it and R beside it:

    R ← P⁻¹ R,   what is below and beside ← that − C R,     S ← −(C of all bands) U + what the
    children leave

so that all but the inverses of small squares are products of BLAS, and every number is touched as
seldom as can be: what takes time beside the products is to bring numbers to the cores. To be
imported where it is used: it takes the compiler along.
"""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled
from orchestrator.method.coarse.front_solves import beside_of, columns_of, loop, multiply

@compiled
def eliminate(start, stop, product, blocks, layout, room, runs):
    """Eliminate fronts, children before parents; raises LinAlgError if a pivot of one vanishes.

    start, stop : of the ``runs``: fronts in the order of work, and where each run of them begins
    product : address of BLAS's product
    blocks : (b, size, size) of the matrix
    layout : as ``elimination.Layout`` has it
    room : three (·,), which take L, U and S
    """
    (own, beside, work), (order, bounds) = room, runs
    band, sizes = layout[0], layout[1]
    right, most = np.empty(
        (sizes[:, 0] * (sizes[:, 1] + np.minimum(sizes[:, 0], band))).max()), layout[10].size
    joined = np.empty((most, 3), np.int64)  # runs of neighbours
    for f in order[bounds[start] : bounds[stop]]:
        a, m = sizes[f]
        _entered(f, blocks, layout, own, work, right, joined)
        for p in range(0, a, band):
            _across(f, p, product, layout, own, beside, right)
        if m:
            _left(f, product, layout, own, beside, work, joined)


@loop
def _entered(f, blocks, layout, own, work, right, runs):
    """Return what enters a front: blocks of the matrix, and what its children leave in the rows and
    columns that it eliminates.

    right : (·,) takes U before it is multiplied
    runs : (·, 3) int, to work in
    """
    _, sizes, places, _, enters, enter, children, child, rests, _, within = layout
    size, (a, m) = blocks.shape[1], sizes[f]
    L, R = columns_of(f, layout, own), right[: a * m].reshape(a, m)
    for flat in (L.reshape(-1), R.reshape(-1)):
        for i in range(len(flat)):
            flat[i] = 0.0
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
        m_c, first = sizes[c, 1], rests[c]
        split, count = _runs(within[first : rests[c + 1]], size, a, runs)
        for u in range(m_c // size):
            for r in range(size):
                to, of = size * within[first + u] + r, places[c, 2] + m_c * (size * u + r)
                _added(own, places[f, 0] + a * to, work, of, runs, 0, split)
                if to < a:
                    _added(right, m * to, work, of, runs, split, count)


@loop
def _across(f, p, product, layout, own, beside, right):
    """Invert a band's square, multiply what is beside it by that, and take its part out of the rows
    below that are still to be eliminated, or left."""
    a, m = layout[1][f]
    L, U, R = columns_of(f, layout, own), beside_of(f, layout, beside), right[: a * m].reshape(a, m)
    q = min(p + layout[0], a)
    w, rest = q - p, a - q
    P = right[a * m : a * m + w * w].reshape(w, w)
    _copied(np.linalg.inv(L[p:q, p:q]), P)
    _copied(P, L[p:q, p:q])
    if m:
        multiply(product, 1.0, P, R[p:q], 0.0, U[p:q])
    if rest:
        others = right[a * m + w * w : a * m + w * w + w * rest].reshape(w, rest)
        _copied(L[p:q, q:], others)
        multiply(product, 1.0, P, others, 0.0, L[p:q, q:])
        multiply(product, -1.0, L[q:, p:q], L[p:q, q:], 1.0, L[q:, q:])
        if m:
            multiply(product, -1.0, L[q:a, p:q], U[p:q], 1.0, R[q:])


@loop
def _left(f, product, layout, own, beside, work, runs):
    """Return what a front leaves."""
    _, sizes, places, _, _, _, children, child, rests, _, within = layout
    a, m = sizes[f]
    S = work[places[f, 2] : places[f, 2] + m * m].reshape(m, m)
    multiply(product, -1.0, columns_of(f, layout, own)[a:], beside_of(f, layout, beside), 0.0, S)
    for k in range(children[f], children[f + 1]):
        c = child[k]
        m_c, first = sizes[c, 1], rests[c]
        size = m_c // (rests[c + 1] - first) if m_c else 0
        split, count = _runs(within[first : rests[c + 1]], size, a, runs)
        for u in range(rests[c + 1] - first):
            for r in range(size):
                to = size * within[first + u] + r - a
                if to >= 0:
                    _added(work, places[f, 2] + m * to, work, places[c, 2] + m_c * (size * u + r),
                           runs, split, count)


@loop
def _copied(given, result):
    """result = given, row after row: numba's own is slow."""
    for i in range(len(given)):
        row, of = result[i], given[i]
        for j in range(len(row)):
            row[j] = of[j]


@loop
def _runs(within, size, own, runs):
    """Runs of neighbours in the parent: where to, where from, how long. What is eliminated there
    comes first, the rest counts
    from its own first row. How many of the first, and of all."""
    split, count = 0, 0
    for v in range(len(within)):
        to = size * within[v]
        if v and within[v] == within[v - 1] + 1 and to != own:
            runs[count - 1, 2] += size
        else:
            runs[count, 0], runs[count, 1], runs[count,
                                                 2] = to if to < own else to - own, size * v, size
            count += 1
        if to < own:
            split = count
    return split, count


@loop
def _added(result, to, given, of, runs, first, last):
    """result += given, run after run, from where ``to`` and ``of`` are on. A view of each would
    take longer than what is done on it,
    and indices without a sign are never counted from the end."""
    for v in range(first, last):
        a, b, length = np.uint64(to + runs[v, 0]), np.uint64(of + runs[v, 1]), np.uint64(runs[v, 2])
        for j in range(length):
            result[a + j] += given[b + j]
