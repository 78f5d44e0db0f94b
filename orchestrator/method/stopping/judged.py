"""The admissible fields of an iterate that results and intervals are made of: v, û and λ̂ of ``stopping.certificate``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.interface.rows import dots, times
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import ROUNDING, Bound
from orchestrator.method.stopping.certificate import Certificate, Certified, Pair
from orchestrator.method.stopping.dual_energy import LEFT, Enough, dual_energy

CLOSELY = 1e-4  # of the smaller of E² and ‖S⁺h‖², what may be left of the latter: a hundredth of û − u


@dataclass(frozen=True)
class Judged:
    """Admissible fields, T load steps.

    pair : v and λ̂
    delta : (T, B) v − u − R y on the boundary dofs
    change : (T, B) h, what λ̂ loads the bodies with beyond the linear stage's forces
    x : (T, B) S⁺h, nearly; left : (T,) energy of what it lacks
    squares, gap : (T,) ‖v − û‖² and Σγ, of all ranks
    half : (T,) ρ² ≥ ‖½(v + û) − u*‖²
    factor : as of the error, nan where that is an estimate
    """

    pair: Pair
    delta: np.ndarray
    change: np.ndarray
    x: np.ndarray
    left: np.ndarray
    squares: np.ndarray
    gap: np.ndarray
    half: np.ndarray
    factor: float


def judged(certificate: Certificate, fields: Admissible, bound: Bound, u: np.ndarray, floor: float = 0.0) -> Judged | None:
    """The admissible fields; None where there are none.

    bound : of these fields; u : (T, B) boundary displacements u + R y that it was measured with
    floor : relative energy error of the bodies' own matrices
    """
    space, stage, delta = certificate.space, certificate.stage, bound.correction
    known = isinstance(bound, Certified)
    pair = bound.pair if known else certificate.pair(fields, u + delta)
    if pair.missing:
        return None
    h = certificate.beside.balanced(certificate.change(fields, pair.forces))
    rest, gap = space.team.sum(dots(delta, times(certificate.stiffness, delta)) - 2 * dots(delta, h), pair.gap)
    worth = np.minimum(rest + 2 * gap, 0.0)
    nothing = (max(ROUNDING, floor) * stage.loading.size(bound.energy)) ** 2
    for share in (CLOSELY, LEFT):  # bodies of which some are far softer than others may not be known so well
        dual = dual_energy(stage, h, worth, Enough(nothing, share), softness=certificate.softness(), begun=bound.dual if known else None)
        if np.isfinite(dual.energy).all():
            break
    else:
        return None
    squares = np.maximum(rest + dual.energy, 0.0)
    whole, factor = squares + 2 * gap, bound.factor if known else certificate.factor()
    # with Coulomb's friction ‖v − u*‖² + ‖û − u*‖² ≤ E²/(1 − q), and the factor is 1/√(1 − q²)
    q = 0.0 if np.isnan(factor) else float(np.sqrt(max(1 - factor ** -2, 0.0)))
    half = 0.5 * whole / (1 - q) - 0.25 * squares + nothing
    if np.isnan(factor):  # load steps begin with the error of those before
        half = np.maximum.accumulate(half)
    left = np.full(len(gap), share * max(whole.sum(), nothing))
    return Judged(pair, delta, h, dual.x, left, squares, gap, half, factor)
