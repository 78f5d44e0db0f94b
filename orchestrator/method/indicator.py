"""Quantities that watch the iterations: the paper's η and what it should not replace.

All are relative and dimensionless. Norms sum over both sides of all interfaces and all load steps.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.linear_stage import Admissible
from orchestrator.method.local_state import LocalState
from orchestrator.method.search_direction import SearchDirection

EXACT_LIMIT = 50_000


def latin_indicator(direction: SearchDirection, stage, fields: Admissible, local: LocalState,
                    exact: bool = False) -> float:
    """The paper's η, eq. (16), transposes mended: a *squared* distance between both solution sets.

    η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)

    It depends on the search direction: small soles make it small whatever the error is.

    Parameters
    ----------
    stage : the local stage; local : its result
    exact : factorise k for the inverse norms even where that is dear; otherwise its diagonal
        stands in for it beyond ``EXACT_LIMIT`` trace dofs
    """
    k, exact = direction.k, exact or len(fields.w) <= EXACT_LIMIT
    if local.force is not None:
        w_hat, f_hat = local.hats
    elif exact:
        w_hat, f_hat = stage.hats(fields.w, fields.f)
    else:
        w_hat, f_hat = stage.lumped_hats(fields.w, fields.f)

    def size(w, f):
        inverse = direction.solve(f) if exact else f / direction.diagonal[:, None]
        return np.sum(w * (k @ w)) + np.sum(f * inverse)

    total = size(fields.w, fields.f) + size(w_hat, f_hat)
    return float(size(fields.w - w_hat, fields.f - f_hat) / total) if total > 0 else 0.0


def displacement_jump(direction: SearchDirection, fields: Admissible) -> float:
    """‖B w‖ / ‖w‖, weighted by the diagonal of k⁻."""
    return _ratio(fields.w[direction.partner] - fields.w, fields.w, direction.diagonal)


def force_imbalance(direction: SearchDirection, fields: Admissible) -> float:
    """‖A f‖ / ‖f‖, weighted by the inverse diagonal of k⁻."""
    return _ratio(fields.f + fields.f[direction.partner], fields.f, 1 / direction.diagonal)


def energy_residual(direction: SearchDirection, fields: Admissible, local: LocalState, energy: np.ndarray) -> float:
    """max_t (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹)^½ / max_t ‖u‖_K: the numerator of η in the units of the energy error.

    Parameters
    ----------
    energy : (T,) ‖u‖²_K; the diagonal of k stands in for it in the inverse norm
    """
    (w_hat, f_hat), k = local.hats, direction.k
    w, f = fields.w - w_hat, fields.f - f_hat
    gap = np.sum(w * (k @ w), axis=0) + np.sum(f**2 / direction.diagonal[:, None], axis=0)
    size = energy.max(initial=0.0)
    return float(np.sqrt(gap.max(initial=0.0) / size)) if size > 0 else 0.0 if not gap.any() else np.inf


def residual_size(direction: SearchDirection, residual: np.ndarray, s: np.ndarray) -> float:
    """‖F(s) − s‖ / ‖F(s)‖, weighted by the inverse diagonal of k⁻."""
    return _ratio(residual, s + residual, 1 / direction.diagonal)


def macro_imbalance(C, fields: Admissible) -> float:
    """Largest |Cᵀf| relative to the largest force resultant of one interface: 0 to rounding, eq. (17)."""
    scale = np.abs(C).T @ np.abs(fields.f)
    return float(np.abs(C.T @ fields.f).max() / scale.max()) if scale.size and scale.max() > 0 else 0.0


def _ratio(part: np.ndarray, whole: np.ndarray, weight: np.ndarray) -> float:
    bottom = np.sum(weight[:, None] * whole**2)
    return float(np.sqrt(np.sum(weight[:, None] * part**2) / bottom)) if bottom > 0 else 0.0
