"""Energy of interface forces, hᵀS⁺h, by conjugate gradients preconditioned with the black box itself.

S is the subdomains' Schur complement on their boundary, which nobody forms: N M⁻¹Nᵀ = (S + NᵀkN)⁻¹ is what the black
box applies, so that S p = (S + k) p − k p, of which the first term follows by recurrence. They begin with what the macro
columns know, for any x₀: hᵀS⁺h = 2 x₀ᵀh − x₀ᵀS x₀ + rᵀS⁺r, r = h − S x₀.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.interface.rows import Segments
from orchestrator.method.linear.stage import LinearStage

RELATIVE_TAIL = 0.02  # the conjugate gradients stop when neither a step nor what is to come adds more of the bound's square
MAX_STEPS = 100
CANCELLED = 1e-13  # of a sum of large terms, what rounding leaves
SLOWEST = 0.95  # rate of the conjugate gradients assumed at worst


def dual_energy(stage: LinearStage, h: np.ndarray, rest: np.ndarray, negligible: float,
                beyond: Callable[[np.ndarray], bool] = lambda total: False) -> tuple[np.ndarray, int]:
    """(T,) hᵀS⁺h over all subdomains, and the back-substitutions spent.

    The iterates approach from below; the geometric tail of the steps is added, and for the
    tail's own error the accuracy that the steps are stopped at. With stiff soles a² and b² are large and
    almost cancelled by the cross term: what counts is the accuracy of the sum. Infinite if it is not reached.

    h : (T, B) forces on the boundary dofs, balanced on floating subdomains
    rest : (T,) what b² is added to: a² and the cross term
    negligible : sum over the steps that is not worth being told from zero
    beyond : of what has been reached so far, (T,), whether it is more than can be of use: what is returned then is that, and
        the true one is larger
    """
    space, of = stage.space, Segments(stage.space.boundary)
    if not space.team.max(h.any())[0]:
        return np.zeros(len(h)), 0
    r, total, p, q, rz_old, steps = h.copy(), np.zeros(len(h)), None, None, None, []
    known = stage.known_answers(h)
    if known is not None:
        x, robin = known
        answered = robin - stage.direction.robin(x)
        total, = space.team.sum(of.sums(x * (2 * h - answered)).sum(axis=1))
        if beyond(total):
            return total, 0
        r -= answered
    for sweeps in range(1, MAX_STEPS + 1):
        z = stage.solve(r)
        rz = np.maximum(of.sums(r * z), 0.0)
        if p is None:
            p, q = z, r.copy()
        else:
            beta = of.spread(_safe_ratio(rz, rz_old))
            p, q = z + beta * p, r + beta * q
        s_p = q - stage.direction.robin(p)
        alpha = _safe_ratio(rz, of.sums(p * s_p))
        gained, = space.team.sum((alpha * rz).sum(axis=1))  # over all subdomains, per load step
        total, r, rz_old = total + gained, r - of.spread(alpha) * s_p, rz
        steps.append(float(gained.sum()))
        if beyond(total):
            return total, sweeps
        tail, worth = _tail(steps), max(np.sum(total + rest), CANCELLED * np.sum(total), negligible)
        if max(steps[-1], tail) <= RELATIVE_TAIL * worth:
            share = gained / max(steps[-1], np.finfo(float).tiny)
            return total + tail * share + RELATIVE_TAIL * np.maximum(total + rest, 0.0), sweeps
    return np.full(len(h), np.inf), MAX_STEPS


def _tail(steps: list[float]) -> float:
    """What the steps to come would add: a geometric series, at the slower of the last two rates."""
    last = steps[-3:]
    rates = [b / a for a, b in zip(last, last[1:]) if a > 0]
    rate = min(max(rates, default=SLOWEST), SLOWEST)
    return steps[-1] * rate / (1 - rate)


def _safe_ratio(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    return np.where(bottom > 0, top / np.where(bottom > 0, bottom, 1.0), 0.0)
