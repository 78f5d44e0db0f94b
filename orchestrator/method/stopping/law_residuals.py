"""How well equilibrium and the interface laws hold together, each relative and dimensionless.

The linear stage satisfies equilibrium, the local stage the laws; the run has converged when one
set of fields does both. Each measure is taken on the linear stage's fields, which are delivered.
Forces and pressures are compared with the largest there are, or with a small share of k⁺ w where
the interfaces carry next to nothing:

- residual     ‖f − f̂‖ / ‖f‖ in the norm of (k⁺)⁻¹, tied dofs included
- imbalance    ‖f₁ + f₂‖ / ‖f‖ in the same norm
- penetration  largest −(g₀ + n·d) over the largest displacement
- tension      largest tensile pressure over the largest pressure
- cone         largest |f_t| − μ|f_n| (as pressure) over the largest pressure
- direction    largest |f_t| |slip| − f_t·slip (friction not opposed to slip, per area) over the largest
               pressure × the largest displacement
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from orchestrator.method.local.state import LocalState
from orchestrator.laws.points import SLIP, dot
from orchestrator.method.interface.pairs import Pairs, PairTraces
from orchestrator.parallel.team import ALONE, Team

# Forces are differences of k w: below this share of it they count as none, as where all contacts are open.
REST = 1e-4


@dataclass(frozen=True)
class LawResiduals:
    """The six measures."""

    residual: float
    imbalance: float
    penetration: float
    tension: float
    cone: float
    direction: float

    @property
    def largest(self) -> float:
        """What the tolerance is compared with."""
        return max(astuple(self))


def law_residuals(pairs: Pairs, w: np.ndarray, f: np.ndarray, local: LocalState, scale: float,
                  first_previous: np.ndarray, team: Team = ALONE) -> LawResiduals:
    """Measure traces (D + G, T) of the linear stage against the local stage.

    Parameters
    ----------
    scale : largest displacement of the structure, at least on its interfaces
    first_previous : (3, P) jump before the first step
    team : the ranks over which to sum and to take the largest
    """
    points, at = pairs.points, PairTraces.of(pairs, w, f)
    contact = np.repeat([i.law == "contact" for i in pairs.interfaces], np.diff(pairs.bounds)).astype(bool)

    def squared(x: np.ndarray, scaled: np.ndarray) -> float:
        """Σ x · scaled, once for pairs between ranks."""
        return float((np.einsum("tip,tip->p", x, scaled) * pairs.mine).sum())

    def norm2(x: np.ndarray) -> float:
        return squared(x, points.compliance(x))

    def largest(x: np.ndarray) -> float:
        return max(x[..., contact].max(initial=0.0), 0.0)

    top = norm2(at.f1 - local.force) + norm2(at.f2 + local.force)
    bottom, unbalanced = norm2(at.f1) + norm2(at.f2), norm2(at.f1 + at.f2)
    moved = squared(at.w1, points.stiffness(at.w1)) + squared(at.w2, points.stiffness(at.w2))
    reach = largest(points.stiff_n * np.abs(at.w1 + at.w2).max(axis=1) / pairs.area)
    carried = 0.5 * (at.f1 - at.f2) / pairs.area
    normal, shear = points.along(carried), points.across(carried)
    size = np.sqrt(dot(shear, shear))
    pressure, tension = largest(np.abs(normal)), largest(normal)
    penetration = largest(-(points.gap + points.along(at.w2 - at.w1)))
    cone = largest(size - points.friction * np.maximum(-normal, 0.0))
    slip = points.across(np.diff(local.jump, axis=0, prepend=first_previous[None]))
    rubbing = contact & (local.status == SLIP) & (points.friction > 0)
    direction = (size * np.sqrt(dot(slip, slip)) - dot(slip, shear))[rubbing].max(initial=0.0)
    tied, weight = pairs.tied, 1 / pairs.tie_stiffness[:, None]
    if len(tied):
        top += float(np.sum(weight * (f[tied] - local.hats[1][tied]) ** 2))
    top, bottom, unbalanced, moved = (float(x) for x in team.sum(top, bottom, unbalanced, moved))
    reach, pressure, penetration, tension, cone, direction = team.max(
        reach, pressure, penetration, tension, cone, direction)
    bottom = max(bottom, REST**2 * moved)
    pressure = max(pressure, REST * reach) or 1.0
    scale = scale or 1.0
    return LawResiduals(_root(top, bottom), _root(unbalanced, bottom), penetration / scale, tension / pressure,
                        cone / pressure, direction / (pressure * scale))


def _root(top: float, bottom: float) -> float:
    return float(np.sqrt(top / bottom)) if bottom > 0 else float(np.sqrt(top))
