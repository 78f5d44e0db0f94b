"""Groups of a few points in contact, compiled: Newton's method for proximal steps, as
``node_newton`` has it, and what the coarse problem's fields change.

A group is worked on to its end before the next one, by dense matrices: r = q − law(q + keq (b − S
q) + τ (q₀ − q)) has three numbers a point. To be imported where it is used: it takes the compiler
along.
"""

from __future__ import annotations

import numba
import numpy as np

from orchestrator.compiled import SUMS, compiled
from orchestrator.laws import contact_loops
from orchestrator.laws.contact_loops import OPENS

fast = numba.njit(nogil=True, fastmath=SUMS)
forces, slopes = fast(contact_loops.forces.function), fast(contact_loops.slopes.function)


@fast
def left(a, b, felt, given, pull, q, F, force, status, r):
    """Write F, f̂ and r (3, R) of the points from a to b; ‖r‖."""
    points, start, past, rest, known, springs, free = given
    m, square = b - a, 0.0
    for c in range(3):
        for j in range(m):
            total, row = start[c, a + j] + pull * (known[c, a + j] - q[c, a + j]), felt[c * m + j]
            for d in range(3):
                for k in range(m):
                    total += row[d * m + k] * q[d, a + k]
            F[c, a + j] = total
    forces(a, b, points, F, past, force, status)
    for c in range(3):
        for p in range(a, b):
            if free[c, p]:
                force[c, p] += springs[p] * (F[c, p] - rest[c, p] - force[c, p])
            else:
                force[c, p] = 0.0
            r[c, p] = q[c, p] - force[c, p]
            square += r[c, p] ** 2
    return np.sqrt(square)


@fast
def slopes_of(a, b, given, F, status, slope, everyone):
    """Write A (3, 3, R) of the points from a to b at F."""
    points, _, past, _, _, springs, free = given
    slopes(a, b, points, F, past, everyone, slope)
    for p in range(a, b):
        for c in range(3):
            for d in range(3):
                value = 0.0 if status[p] == OPENS else slope[c, d, p]
                value += springs[p] * ((1.0 if c == d else 0.0) - value)
                slope[c, d, p] = value if free[c, p] and free[d, p] else 0.0


@fast
def eliminated(J, n, columns):
    """Put J⁻¹ R into the place of R, of (J, R) in one array (n, n + columns), rows exchanged;
    whether there is one.
    """
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(J[i, k]) > abs(J[best, k]):
                best = i
        if not abs(J[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(k, n + columns):
                J[k, j], J[best, j] = J[best, j], J[k, j]
        for i in range(k + 1, n):
            share = J[i, k] / J[k, k]
            if share != 0.0:
                for j in range(k + 1, n + columns):
                    J[i, j] -= share * J[k, j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            share = J[i, k]
            for j in range(n, n + columns):
                J[i, j] -= share * J[k, j]
        for j in range(n, n + columns):
            J[i, j] /= J[i, i]
    return True


@fast
def jacobian(a, b, felt, slope, pull, J):
    """Write J = 1 − A (1 − keq S − τ) of the points from a to b."""
    m = b - a
    for c in range(3):
        for j in range(m):
            row = J[c * m + j]
            for k in range(3 * m):
                total = 0.0
                for d in range(3):
                    total += slope[c, d, a + j] * felt[d * m + j, k]
                row[k] = pull * slope[c, k // m, a + j] - total if k % m == j else -total
            row[c * m + j] += 1.0


@fast
def newton(a, b, felt, given, pull, enough, effort, q, room):
    """Improve q (3, R) at the points from a to b; ‖r‖ there."""
    _, rounds, lengths, less = effort
    F, force, status, r, here, slope, everyone, step, best, J = room
    m = b - a
    n, size, number = 3 * m, np.inf, 0
    best[:, a:b] = q[:, a:b]
    while True:
        found = left(a, b, felt, given, pull, q, F, force, status, r)
        if found < (1.0 - less * lengths[number]) * size:
            size, number = found, 0
            for c in range(3):
                for p in range(a, b):
                    best[c, p], here[c, p] = q[c, p], r[c, p]
            if size <= enough or rounds == 0:
                break
            rounds -= 1
            slopes_of(a, b, given, F, status, slope, everyone)
            jacobian(a, b, felt, slope, pull, J)
            for k in range(n):
                J[k, n] = here[k // m, a + k % m]
            if not eliminated(J, n, 1):
                break
            for k in range(n):
                step[k // m, a + k % m] = J[k, n]
        else:
            number += 1
            if number == len(lengths):
                break
        for c in range(3):
            for p in range(a, b):
                q[c, p] = best[c, p] - lengths[number] * step[c, p]
    q[:, a:b] = best[:, a:b]
    return size


@compiled
def answered(start, stop, groups, given, enough, effort, q, size):
    """Write q (3, R) and ‖r‖ (n,) of the groups from start to stop.

    groups : (n + 1,) int, where each one's points begin; (n,) int, where its matrix 1 − keq S
        begins in (·,)
    given : of the points normal, stiff_n, stiff_t, gap and friction; keq b, jumps before, keq
        times the jumps at which springs carry nothing, q₀, ε, and which components are free
    enough : (n,) what may be left of ‖r‖
    effort : τ, tried in turn; Newton steps with each; their lengths, and what each has to save
    """
    bounds, places, matrices = groups
    count, most = q.shape[1], 0
    for g in range(start, stop):
        most = max(most, bounds[g + 1] - bounds[g])
    work = np.empty((6, 3, count))
    room = (work[0], work[1], np.empty(count, np.int64), work[2], work[3], np.empty((3, 3, count)),
            np.arange(count), work[4], work[5], np.empty((3 * most, 3 * most + 1)))
    for g in range(start, stop):
        a, b = bounds[g], bounds[g + 1]
        n = 3 * (b - a)
        felt = matrices[places[g] : places[g] + n * n].reshape(n, n)
        for pull in effort[0]:
            q[:, a:b] = given[4][:, a:b]
            size[g] = newton(a, b, felt, given, pull, enough[g], effort, q, room)
            if size[g] <= enough[g]:
                break


@compiled
def added(start, stop, groups, bodies, fields, laws, pull, result):
    """result (·, n, n) += Tᵀ X D of the groups from start to stop, X = J⁻¹ A keq, in blocks of
    their bodies.

    groups : as ``node_loops.answered`` takes them
    bodies : (k + 1,) int, where the bodies of each group begin; (Q, 2) int, which of them a
        point's two are; (·,) int,
        where the block of two of them is in ``result``, row after row, and (k,) where those of
        each group begin
    fields : T and D (Q, 3, 2, n); laws : A and keq (3, 3, Q)
    """
    (bounds, places, matrices), (first, local, spots,
                                 begins), (T, D), (slope, stiff) = groups, bodies, fields, laws
    size = T.shape[3]
    for g in range(start, stop):
        a, b, count = bounds[g], bounds[g + 1], first[g + 1] - first[g]
        m, width = b - a, count * size
        n = 3 * m
        J, carried = np.zeros((n, n + width)), np.zeros((width, n))
        jacobian(a, b, matrices[places[g] : places[g] + n * n].reshape(n, n), slope, pull, J)
        for j in range(m):
            for side in range(2):
                here = local[a + j, side] * size
                for c in range(3):
                    for f in range(size):
                        carried[here + f, c * m + j] += T[a + j, c, side, f]
                    for e in range(3):
                        share = 0.0
                        for d in range(3):
                            share += slope[c, d, a + j] * stiff[d, e, a + j]
                        for f in range(size):
                            J[c * m + j, n + here + f] += share * D[a + j, e, side, f]
        if not eliminated(J, n, width):
            continue
        product = np.dot(carried, np.ascontiguousarray(J[:, n:]))
        for i in range(count):
            for k in range(count):
                spot = spots[begins[g] + i * count + k]
                for f in range(size):
                    for h in range(size):
                        result[spot, f, h] += product[i * size + f, k * size + h]
