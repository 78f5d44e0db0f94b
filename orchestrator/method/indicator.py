"""Quantities that watch the iterations: the paper's η and what it should not replace.

All are relative and dimensionless. Norms sum over both sides of all interfaces and all load steps.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.linear_stage import Admissible
from orchestrator.method.local_stage import PerfectInterfaces
from orchestrator.method.search_direction import SearchDirection


def latin_indicator(direction: SearchDirection, local: PerfectInterfaces, fields: Admissible) -> float:
    """The paper's η, eq. (16), transposes mended: a *squared* distance between both solution sets.

    η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)

    It depends on the search direction: small soles make it small whatever the error is.
    """
    w_hat, f_hat = local.hats(fields.w, fields.f)
    k, solve = direction.k, direction.solve

    def size(w, f):
        return np.sum(w * (k @ w)) + np.sum(f * solve(f))

    total = size(fields.w, fields.f) + size(w_hat, f_hat)
    return float(size(fields.w - w_hat, fields.f - f_hat) / total) if total > 0 else 0.0


def displacement_jump(direction: SearchDirection, fields: Admissible) -> float:
    """‖B w‖ / ‖w‖, weighted by the diagonal of k⁻."""
    return _ratio(fields.w[direction.partner] - fields.w, fields.w, direction.diagonal)


def force_imbalance(direction: SearchDirection, fields: Admissible) -> float:
    """‖A f‖ / ‖f‖, weighted by the inverse diagonal of k⁻."""
    return _ratio(fields.f + fields.f[direction.partner], fields.f, 1 / direction.diagonal)


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
