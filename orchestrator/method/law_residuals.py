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

from orchestrator.method.local_state import LocalState
from orchestrator.method.laws.points import SLIP
from orchestrator.method.pairs import Pairs
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
    first_previous : (P, 3) jump before the first step
    team : the ranks over which to sum and to take the largest
    """
    points, contact = pairs.points, np.zeros(len(pairs), bool)
    for i, a, b in zip(pairs.interfaces, pairs.bounds[:-1], pairs.bounds[1:]):
        contact[a:b] = i.law == "contact"
    top = bottom = unbalanced = penetration = tension = cone = direction = pressure = 0.0
    moved = reach = 0.0
    previous = first_previous
    for t in range(w.shape[1]):
        f1, f2 = pairs.gather(f[:, t], pairs.one), pairs.gather(f[:, t], pairs.two)
        gap1, gap2 = f1 - local.force[t], f2 + local.force[t]
        mine = pairs.mine[:, None]  # pairs between ranks are summed once
        top += _norm2(points, gap1 * mine) + _norm2(points, gap2 * mine)
        bottom += _norm2(points, f1 * mine) + _norm2(points, f2 * mine)
        unbalanced += _norm2(points, (f1 + f2) * mine)

        w1, w2 = pairs.gather(w[:, t], pairs.one), pairs.gather(w[:, t], pairs.two)
        moved += float(np.sum(mine * w1 * points.stiffness(w1)) + np.sum(mine * w2 * points.stiffness(w2)))
        reach = max(reach, (points.stiff_n * np.abs(w1 + w2).max(axis=1) / pairs.area)[contact].max(initial=0.0))
        d = w2 - w1
        carried = 0.5 * (f1 - f2)
        normal = points.along(carried) / pairs.area
        shear = points.across(carried) / pairs.area[:, None]
        size = np.linalg.norm(shear, axis=1)
        here = contact
        pressure = max(pressure, np.abs(normal[here]).max(initial=0.0))
        penetration = max(penetration, (-(points.gap + points.along(d)))[here].max(initial=0.0))
        tension = max(tension, normal[here].max(initial=0.0))
        cone = max(cone, (size - points.friction * np.maximum(-normal, 0.0))[here].max(initial=0.0))
        slip = points.across(local.jump[t] - previous)
        wrong = size * np.linalg.norm(slip, axis=1) - np.einsum("pi,pi->p", slip, shear)
        rubbing = contact & (local.status[t] == SLIP) & (points.friction > 0)
        direction = max(direction, wrong[rubbing].max(initial=0.0))
        previous = local.jump[t]
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


def _norm2(points, x: np.ndarray) -> float:
    return float(np.sum(x * points.compliance(x)))


def _root(top: float, bottom: float) -> float:
    return float(np.sqrt(top / bottom)) if bottom > 0 else float(np.sqrt(top))
