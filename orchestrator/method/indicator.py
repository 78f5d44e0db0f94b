"""Quantities that watch the iterations: the paper's η and what it should not replace.

All are relative and dimensionless. Norms sum over both sides of all interfaces and all load steps, and over
all ranks: their parts are summed together, while the rank goes on with something else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orchestrator.method.linear_stage import Admissible
from orchestrator.method.local_state import LocalState
from orchestrator.method.search_direction import SearchDirection

EXACT_LIMIT = 50_000


@dataclass(frozen=True)
class Measures:
    """What is known of one iteration before any criterion.

    Parameters
    ----------
    indicator : the paper's η, see ``latin_parts``
    displacement_jump : ‖B w‖ / ‖w‖, weighted by the diagonal of k⁻
    force_imbalance : ‖A f‖ / ‖f‖, weighted by the inverse diagonal of k⁻
    residual : ‖F(s) − s‖ / ‖F(s)‖, in the same norm
    macro_imbalance : largest |Cᵀf| relative to the largest force resultant of one interface: 0 to rounding,
        eq. (17); nan without macro problem
    counts : pairs that are open, stick and slip, summed over the steps
    """

    indicator: float
    displacement_jump: float
    force_imbalance: float
    residual: float
    macro_imbalance: float
    counts: tuple[int, int, int]


def measure(direction: SearchDirection, stage, macro, fields: Admissible, local: LocalState, residual: np.ndarray,
            exact: bool) -> Callable[[], Measures]:
    """Begin to measure; calling what is returned waits for the other ranks' parts.

    Parameters
    ----------
    stage : the local stage; local : its result
    macro : macro problem or None
    residual : (D, T) F(s) − s
    exact : η exactly, whatever it costs
    """
    k, space = direction.diagonal[:, None], direction.space
    w, f = fields.w, fields.f
    w_other, f_other = (x[space.partner] for x in space.extended(w, f))
    parts = [*latin_parts(direction, stage, fields, local, exact),
             np.sum(k * (w_other - w) ** 2), np.sum(k * w**2),
             np.sum((f + f_other) ** 2 / k), np.sum(f**2 / k),
             np.sum(residual**2 / k), np.sum((fields.s + residual) ** 2 / k), np.array(local.counts)]
    if macro is not None:
        parts += [macro.C.T @ f, np.abs(macro.C).T @ np.abs(f)]
    sums = space.team.sum_later(*parts)

    def result() -> Measures:
        gap, total, jump, moved, imbalance, force, change, state, counts, *resultant = sums()
        eta = float(gap / total) if total > 0 else 0.0
        macro_imbalance = np.nan
        if resultant:
            unbalanced, scale = (np.abs(r).max(initial=0.0) for r in resultant)
            macro_imbalance = float(unbalanced / scale) if scale > 0 else 0.0
        return Measures(eta, _ratio(jump, moved), _ratio(imbalance, force), _ratio(change, state), macro_imbalance,
                        tuple(int(c) for c in counts))

    return result


def latin_parts(direction: SearchDirection, stage, fields: Admissible, local: LocalState,
                exact: bool = False) -> tuple[float, float]:
    """This rank's part of numerator and denominator of the paper's η, eq. (16), transposes mended.

    η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)

    It is a *squared* distance between both solution sets, and depends on the search direction: small soles
    make it small whatever the error is.

    Parameters
    ----------
    exact : factorise k for the inverse norms even where that is dear; otherwise its diagonal
        stands in for it beyond ``EXACT_LIMIT`` trace dofs
    """
    k, exact = direction.k, exact or direction.space.total <= EXACT_LIMIT
    if local.force is not None:
        w_hat, f_hat = local.hats
    elif exact:
        w_hat, f_hat = stage.hats(fields.w, fields.f)
    else:
        w_hat, f_hat = stage.lumped_hats(fields.w, fields.f)

    def size(w, f):
        inverse = direction.solve(f) if exact else f / direction.diagonal[:, None]
        return np.sum(w * (k @ w)) + np.sum(f * inverse)

    return (size(fields.w - w_hat, fields.f - f_hat),
            size(fields.w, fields.f) + size(w_hat, f_hat))


def energy_residual(direction: SearchDirection, fields: Admissible, local: LocalState, energy: np.ndarray) -> float:
    """max_t (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹)^½ / max_t ‖u‖_K: the numerator of η in the units of the energy error.

    Parameters
    ----------
    energy : (T,) ‖u‖²_K; the diagonal of k stands in for it in the inverse norm
    """
    (w_hat, f_hat), k = local.hats, direction.k
    w, f = fields.w - w_hat, fields.f - f_hat
    gap, = direction.space.team.sum(
        np.sum(w * (k @ w), axis=0) + np.sum(f**2 / direction.diagonal[:, None], axis=0))
    size = energy.max(initial=0.0)
    return float(np.sqrt(gap.max(initial=0.0) / size)) if size > 0 else 0.0 if not gap.any() else np.inf


def _ratio(part: np.ndarray, whole: np.ndarray) -> float:
    return float(np.sqrt(part / whole)) if whole > 0 else 0.0
