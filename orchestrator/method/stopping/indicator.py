"""Quantities that watch the iterations: the paper's η and what it should not replace.

All are relative and dimensionless. Norms sum over both sides of all interfaces and all load steps,
and over all ranks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local_stage import LocalState

EXACT_LIMIT = 50_000  # trace dofs, beyond which a factor of k for the inverse norm is dear


@dataclass(frozen=True)
class Measures:
    """Measures of one iteration, before any criterion.

    indicator : the paper's η, see ``latin_parts``
    displacement_jump : ‖B w‖ / ‖w‖, weighted by the diagonal of k⁻
    force_imbalance : ‖A f‖ / ‖f‖, weighted by the inverse diagonal of k⁻
    residual : ‖F(s) − s‖ / ‖F(s)‖, in the same norm
    macro_imbalance : largest |Cᵀf| relative to the largest force resultant of one interface: 0 to
        rounding, eq. 17; nan without macro problem
    counts : name of a status → pairs that have it, summed over the steps
    moved : largest interface displacement of the linear stage
    asked : 1 where the codes were asked, 0 for a state of zeros
    """

    indicator: float
    displacement_jump: float
    force_imbalance: float
    residual: float
    macro_imbalance: float
    counts: dict[str, int]
    moved: float
    asked: float

    @property
    def values(self) -> dict[str, float]:
        """Those that the history has."""
        return {name: getattr(self, name)
                for name in ("indicator", "displacement_jump", "force_imbalance", "residual",
                             "macro_imbalance")}


def measure(problem: Decomposition, fields: Admissible, local: LocalState, residual: np.ndarray,
            exact: bool,
            ends: tuple[float, float]) -> Measures:
    """Measure an iteration; one message among ranks.

    residual : (T, D) F(s) − s
    exact : η exactly, whatever it costs
    ends : this rank's largest displacement, and whether codes were asked
    """
    k, space, macro = problem.stage.direction.diagonal, problem.space, problem.stage.macro
    w, f, counted = fields.w, fields.f, problem.local.counts(local)
    if space.by_nodes:
        others = problem.local.others(w, f)
        apart, unbalanced = others[0] - w, others[1] + f
    else:
        both = space.transfer.mismatch, space.transfer.imbalance
        apart, unbalanced = (of(x) for of, x in zip(both, fields.extended))
    squares = [_square(apart, k), _square(w, k), _square(unbalanced, 1 / k), _square(f, 1 / k),
               _square(residual, 1 / k), _square(fields.s + residual, 1 / k)]
    resultant = (np.nan, 1.0) if macro is None else macro.imbalance(fields.extended[1])
    (gap, total, counts, *squares), (*ends, unbalanced, scale) = space.team.both(
        [*latin_parts(problem, fields, local, exact), np.array(list(counted.values())), *squares],
        [*ends, *resultant])
    ratios = [float(np.sqrt(part / whole)) if whole > 0 else 0.0
              for part, whole in zip(squares[::2], squares[1::2])]
    return Measures(float(gap / total) if total > 0 else 0.0, *ratios,
                    unbalanced / scale if scale > 0 else 0.0,
                    dict(zip(counted, counts.astype(int).tolist())), *ends)


def latin_parts(problem: Decomposition, fields: Admissible, local: LocalState,
                exact: bool) -> tuple[float, float]:
    """This rank's part of numerator and denominator of the paper's η, eq. 16, transposes mended.

    η = (‖w − ŵ‖²_k + ‖f − f̂‖²_k⁻¹) / (‖w‖²_k + ‖f‖²_k⁻¹ + ‖ŵ‖²_k + ‖f̂‖²_k⁻¹)

    It is a *squared* distance between both solution sets, and depends on the search direction:
    small soles make it small whatever the error is.

    exact : factorise k for the inverse norms even where that is dear; otherwise its diagonal
        stands in for it beyond ``EXACT_LIMIT`` trace dofs
    """
    stage, w, f = problem.stage, fields.w, fields.f
    direction = stage.direction
    exact = exact or direction.space.link.total <= EXACT_LIMIT
    kw = stage.robin_of(fields) - f  # known: no product with k
    if local.force is not None:
        w_hat, f_hat, kw_hat = local.hats
    else:
        w_hat, f_hat = (problem.local if exact else problem.local.lumped).hats(*fields.extended)
        kw_hat = direction.times(w_hat)

    apart = f - f_hat
    if exact:
        solved, given = np.split(direction.solve(np.concatenate([apart, f])), 2)  # at once
    else:
        solved, given = apart / direction.diagonal, f / direction.diagonal
    square = float(np.vdot(apart, solved))
    both = float(2 * (np.vdot(f, given) - np.vdot(apart, given))) + square  # ‖f‖² + ‖f − apart‖²
    return float(np.vdot(w - w_hat, kw - kw_hat)) + square, float(
        np.vdot(w, kw) + np.vdot(w_hat, kw_hat)) + both


def _square(x: np.ndarray, weight: np.ndarray) -> float:
    """Weighted sum of squares of (T, D)."""
    return float(np.einsum("ti,ti,i->", x, x, weight))
