"""Stresses of four-node tets, their means at nodes and the squares of what lies between, compiled.

For scenes where something opens, whose stages are compiled anyway; elsewhere ``stress`` and ``discretisation`` need no
compiler. What the formulas are is said there.
"""

from __future__ import annotations

import numpy as np

from orchestrator.compiled import compiled, in_parts

_ROTATIONS = 90  # of Jacobi's at most; a sweep has three, and six sweeps bring 3×3 matrices to rounding


def volumes(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) of tets (m, 4) on nodes (n, 3)."""
    result = np.empty(len(cells))
    in_parts(_volumes, len(cells), *map(np.ascontiguousarray, (nodes, cells)), result)
    return result


def stresses(nodes: np.ndarray, cells: np.ndarray, lame: np.ndarray, displacement: np.ndarray,
             thermal: np.ndarray | None) -> np.ndarray:
    """(6, m) stress of tets (m, 4) with displacements (n, 3); ``thermal``: (m,) strain without stress, None: there is none."""
    result = np.empty((6, len(cells)))
    in_parts(_stresses, len(cells), *map(np.ascontiguousarray, (nodes, cells, lame, displacement)),
             np.empty(0) if thermal is None else thermal, result)
    return result


def sums_at_nodes(corner: np.ndarray, weight: np.ndarray, sigma: np.ndarray, count: int) -> np.ndarray:
    """(6, count) sums of stresses (6, m) times the tets' weights (m,) at their corners (m, 4)."""
    result = np.zeros((6, count))
    in_parts(_sums, 6, corner, weight, np.ascontiguousarray(sigma), result, part=1)
    return result


def squares(corner: np.ndarray, sigma: np.ndarray, mean: np.ndarray, lame: np.ndarray, weight: np.ndarray,
            softest: float) -> tuple[np.ndarray, np.ndarray]:
    """(m,) η² and (m,) energy of each tet.

    Parameters
    ----------
    corner : (m, 4) int; sigma : (6, m); mean : (6, K) at the nodes; lame : (m, 2); weight : (m,) volumes
    softest : of λ/(3λ + 2μ), the least that counts in η²
    """
    error, energy = np.empty((2, len(corner)))
    in_parts(_squares, len(corner), *map(np.ascontiguousarray, (corner, sigma, mean, lame)), weight, softest, error, energy)
    return error, energy


def principal(sigma: np.ndarray) -> np.ndarray:
    """(K, 3) principal stresses of (K, 6), the largest first; nan of nan."""
    result = np.empty((len(sigma), 3))
    in_parts(_principal, len(sigma), np.ascontiguousarray(sigma.T), result, _ROTATIONS)
    return result


@compiled
def _volumes(start, stop, nodes, cells, result):
    for i in range(start, stop):
        p, q, r, s = nodes[cells[i, 0]], nodes[cells[i, 1]], nodes[cells[i, 2]], nodes[cells[i, 3]]
        a0, a1, a2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        b0, b1, b2 = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        c0, c1, c2 = s[0] - p[0], s[1] - p[1], s[2] - p[2]
        result[i] = ((a1 * b2 - a2 * b1) * c0 + (a2 * b0 - a0 * b2) * c1 + (a0 * b1 - a1 * b0) * c2) / 6


@compiled
def _stresses(start, stop, nodes, cells, lame, u, thermal, result):
    for i in range(start, stop):
        o, p, q, r = cells[i, 0], cells[i, 1], cells[i, 2], cells[i, 3]
        a0, a1, a2 = nodes[p, 0] - nodes[o, 0], nodes[p, 1] - nodes[o, 1], nodes[p, 2] - nodes[o, 2]
        b0, b1, b2 = nodes[q, 0] - nodes[o, 0], nodes[q, 1] - nodes[o, 1], nodes[q, 2] - nodes[o, 2]
        c0, c1, c2 = nodes[r, 0] - nodes[o, 0], nodes[r, 1] - nodes[o, 1], nodes[r, 2] - nodes[o, 2]
        # gradients of the shape functions of the last three corners
        x0, x1, x2 = b1 * c2 - b2 * c1, b2 * c0 - b0 * c2, b0 * c1 - b1 * c0
        y0, y1, y2 = c1 * a2 - c2 * a1, c2 * a0 - c0 * a2, c0 * a1 - c1 * a0
        z0, z1, z2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
        whole = 1.0 / (a0 * x0 + a1 * x1 + a2 * x2)
        x0, x1, x2, y0, y1, y2 = x0 * whole, x1 * whole, x2 * whole, y0 * whole, y1 * whole, y2 * whole
        z0, z1, z2 = z0 * whole, z1 * whole, z2 * whole
        d0, d1, d2 = u[p, 0] - u[o, 0], u[p, 1] - u[o, 1], u[p, 2] - u[o, 2]
        e0, e1, e2 = u[q, 0] - u[o, 0], u[q, 1] - u[o, 1], u[q, 2] - u[o, 2]
        f0, f1, f2 = u[r, 0] - u[o, 0], u[r, 1] - u[o, 1], u[r, 2] - u[o, 2]
        own = thermal[i] if len(thermal) else 0.0
        xx = d0 * x0 + e0 * y0 + f0 * z0 - own
        yy = d1 * x1 + e1 * y1 + f1 * z1 - own
        zz = d2 * x2 + e2 * y2 + f2 * z2 - own
        first, second = lame[i, 0], lame[i, 1]
        pressure = first * (xx + yy + zz)
        result[0, i], result[1, i], result[2, i] = 2 * second * xx + pressure, 2 * second * yy + pressure, 2 * second * zz + pressure
        result[3, i] = second * (d0 * x1 + e0 * y1 + f0 * z1 + d1 * x0 + e1 * y0 + f1 * z0)
        result[4, i] = second * (d1 * x2 + e1 * y2 + f1 * z2 + d2 * x1 + e2 * y1 + f2 * z1)
        result[5, i] = second * (d0 * x2 + e0 * y2 + f0 * z2 + d2 * x0 + e2 * y0 + f2 * z0)


@compiled
def _sums(start, stop, corner, weight, sigma, result):
    """Of the components from start to stop."""
    for c in range(start, stop):
        for i in range(len(corner)):
            share = weight[i] * sigma[c, i]
            for k in range(4):
                result[c, corner[i, k]] += share


@compiled
def _squares(start, stop, corner, sigma, mean, lame, weight, softest, error, energy):
    for i in range(start, stop):
        first, second = lame[i, 0], lame[i, 1]
        dilation = first / (3 * first + 2 * second)
        gaps, own, traces, trace = 0.0, 0.0, 0.0, sigma[0, i] + sigma[1, i] + sigma[2, i]
        t0, t1, t2, t3 = 0.0, 0.0, 0.0, 0.0
        for c in range(6):
            here, times = sigma[c, i], 1.0 if c < 3 else 2.0
            g0, g1 = mean[c, corner[i, 0]] - here, mean[c, corner[i, 1]] - here
            g2, g3 = mean[c, corner[i, 2]] - here, mean[c, corner[i, 3]] - here
            total = g0 + g1 + g2 + g3
            # ∫ λₐ λ_b over a tet: a tenth of its volume where a = b, else a twentieth
            gaps += times * (g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3 + total * total) / 20
            own += times * here * here
            if c < 3:
                t0, t1, t2, t3 = t0 + g0, t1 + g1, t2 + g2, t3 + g3
        total = t0 + t1 + t2 + t3
        traces = (t0 * t0 + t1 * t1 + t2 * t2 + t3 * t3 + total * total) / 20
        scale = weight[i] / (2 * second)
        error[i] = max(gaps - min(dilation, softest) * traces, 0.0) * scale
        energy[i] = (own - dilation * trace * trace) * scale


@compiled
def _principal(start, stop, sigma, result, rotations):
    """By Jacobi's rotations, which find equal values as well as others."""
    for i in range(start, stop):
        a, b, c, d, e, f = sigma[0, i], sigma[1, i], sigma[2, i], sigma[3, i], sigma[4, i], sigma[5, i]
        least = 1e-18 * (abs(a) + abs(b) + abs(c) + abs(d) + abs(e) + abs(f))  # less than rounding of the values
        for _ in range(rotations):
            if not abs(d) + abs(e) + abs(f) > least:
                break
            if d != 0.0:
                slope = (b - a) / (2 * d)
                t = (1.0 if slope >= 0 else -1.0) / (abs(slope) + (slope * slope + 1) ** 0.5)
                cosine = 1 / (t * t + 1) ** 0.5
                sine = t * cosine
                a, b, d = a - t * d, b + t * d, 0.0
                f, e = cosine * f - sine * e, sine * f + cosine * e
            a, b, c, d, e, f = b, c, a, e, f, d  # the next two rows are the first two
        if abs(a + b + c + d + e + f) < np.inf:
            low, high = min(a, b, c), max(a, b, c)
            result[i, 0], result[i, 2] = high, low
            result[i, 1] = max(min(a, b), min(max(a, b), c))
        else:
            result[i, 0] = result[i, 1] = result[i, 2] = np.nan
