"""The admissible fields of an iterate that results and intervals are made of: v, û and λ̂ of ``stopping.certificate``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import Answer
from orchestrator.method.interface.pairs import History
from orchestrator.method.interface.rows import dots, times
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import ROUNDING, Bound
from orchestrator.method.stopping.certificate import Certificate, Certified
from orchestrator.method.stopping.dual_energy import LEFT, Enough, dual_energy

CLOSELY = 1e-4  # of the smaller of E² and ‖S⁺h‖², what may be left of the latter: a hundredth of û − u


@dataclass(frozen=True)
class Judged:
    """Admissible fields, T load steps.

    delta : (T, B) v − u − R y on the boundary dofs; jump : (T, 3, P) of v; before : what each load step begins with
    forces, predicted : (T, 3, P) λ̂, and F that laws answer by it; answers : these, load step by load step
    change : (T, B) h, what λ̂ loads the bodies with beyond the linear stage's forces
    x : (T, B) S⁺h, nearly; left : (T,) energy of what it lacks
    squares, gap : (T,) ‖v − û‖² and Σγ, of all ranks
    half : (T,) ρ² ≥ ‖½(v + û) − u*‖²
    factor : as of the error, nan where that is an estimate
    """

    delta: np.ndarray
    jump: np.ndarray
    before: list[History]
    forces: np.ndarray
    predicted: np.ndarray
    answers: list[Answer]
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
    space, pairs, stage, delta = certificate.space, certificate.pairs, certificate.stage, bound.correction
    known = isinstance(bound, Certified)
    if known and (bound.unbalanced.any() or bound.broken.any()):
        return None
    v, = space.extended(stage.trace(u + delta))
    jump = pairs.transfer.jump(v)
    predicted = bound.forces + pairs.points.stiffness(bound.lawful) if known else pairs.traces(*fields.extended).predicted()
    radius, before, begun, answers, forces, gap = certificate.radius(fields), certificate.before, [], [], [], []
    for t, number in enumerate(pairs.numbers):
        if known:
            answer, force = pairs.force(predicted[t], before, number), bound.forces[t]
        else:
            balanced = certificate.forces(predicted[t], fields.f[t], before, number, radius)
            if balanced.unbalanced.any():
                return None
            answer, predicted[t], force = balanced.answer, balanced.F, balanced.answer.force
        gap.append(pairs.duality_gap(force, jump[t], before, number).sum())
        begun.append(before)
        before = History(jump[t], answer.own)
        answers.append(answer)
        forces.append(force)
    forces = np.array(forces)
    h = certificate.beside.balanced(certificate.change(fields, forces))
    rest, gap = space.team.sum(dots(delta, times(certificate.stiffness, delta)) - 2 * dots(delta, h), np.array(gap))
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
    return Judged(delta, jump, begun, forces, predicted, answers, h, dual.x, left, squares, gap, half, factor)
