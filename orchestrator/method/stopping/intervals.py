"""Intervals that contain the true value of a displacement or of a force, from the energy error.

With v, û and λ̂ of ``stopping.certificate``, u* and λ* the solution and γ ≥ 0 the laws' duality gap: a displacement Q(u) = qᵀu follows
from any lawful forces λ̂_t that balance the loads and t q beside them, and û_t, what the bodies do under both,

    t Q(u* − v) ≤ ¼ ‖v − û_t‖² + Σ γ(v, λ̂_t),      t of either sign.

For ‖v − u*‖² + ‖û_t − u*‖² + 2 Σ [γ(v, λ*) + γ(u*, λ̂_t)] + 2 t Q(u* − v) = ‖v − û_t‖² + 2 Σ γ(v, λ̂_t) as in the certificate, and the
first two terms are at least ½ ‖v − û_t‖². A force R = r·(supports' reactions) − c·λ follows from any field r̃ that moves supports by r and
has the jump c, and none at all other pairs,

    t (R* − R̂) ≤ ¼ ‖v + t r̃ − û‖² + Σ γ(v, λ̂),      so that      R* − R̂ = ½ a(v − û, r̃) ± ρ ‖r̃‖,      ρ² = ¼ ‖v − û‖² + Σ γ(v, λ̂)

half of what Cauchy's and Schwarz's inequality says beside û alone. What matter carries is such a force, with a jump inside a body
(``influence``). Bodies that nothing but contact holds are no exception: pressed sides
carry t q as long as they are pressed. Where no λ̂_t is found there is no interval. Where laws are convex intervals are guaranteed. With
Coulomb's friction they are where the error is, by its factor, and contact then carries nothing of t q; elsewhere they are estimates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.interface.rows import dots, times
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.certificate import Certificate
from orchestrator.method.stopping.dual_energy import Enough, dual_energy
from orchestrator.method.stopping.influence import Influence
from orchestrator.method.stopping.judged import Judged

LESS, TRIES = 0.1, 8  # what t is lowered by where no forces are found, and how often it is tried
BETTER, SEARCHES = 0.3, 3  # change of log t that is worth another evaluation, and evaluations for it


@dataclass(frozen=True)
class PointLoads:
    """n unit loads q, whose work is a displacement each.

    boundary : (n, B) q on boundary dofs; moved : (n, B) M⁻¹q there
    energy : (n,) qᵀM⁻¹q of all ranks
    resultant : per own subdomain (n, 6), in the motions of ``AdmissibleForces``
    """

    boundary: np.ndarray
    moved: np.ndarray
    energy: np.ndarray
    resultant: list[np.ndarray]


def of_forces(certificate: Certificate, at: Judged, influence: Influence, carried: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(n, T, 2) R* − R̂ of n forces, at least and at most.

    carried : (n, T) work of K χ in û − u, of all ranks, zero where nothing is moved by χ
    rest : (T, B) loads ε on û beyond those of λ̂; they are made up for where something is
    """
    strained, astray = certificate.space.team.sum(influence.forces @ at.delta.T - influence.boundary @ at.change.T,
                                                  influence.boundary @ rest.T)
    middle = 0.5 * (strained - carried + np.where(influence.moved[:, None], astray, 0.0))
    # of û a little is left
    far = (np.sqrt(at.half) + np.sqrt(at.left))[None] * np.sqrt(influence.energy)[:, None]
    return np.stack([middle - far, middle + far], axis=2)


def of_displacements(certificate: Certificate, fields: Admissible, at: Judged, loads: PointLoads) -> np.ndarray:
    """(n, T, 2) Q(u*) − Q(v) of n displacements, at least and at most; infinite where no forces carry the load."""
    work, count = _Work(certificate, fields, at, loads), len(loads.energy)
    result = np.full((count, len(at.gap), 2), np.inf)
    guess = 2 * np.sqrt(at.half)[None] / np.sqrt(np.maximum(loads.energy, np.finfo(float).tiny))[:, None]
    size = np.repeat(guess[:, :, None], 2, axis=2)
    wanted = np.repeat((loads.energy > 0)[:, None, None], len(at.gap), axis=1) & np.ones(2, dtype=bool)
    result[loads.energy <= 0] = 0.0  # of what is prescribed
    for attempt in range(TRIES):
        j, t, side = np.nonzero(wanted)
        if not len(j):
            break
        tau = size[j, t, side]
        value, curved = work(j, t, np.where(side == 0, -tau, tau))
        result[j, t, side], known = np.minimum(value, result[j, t, side]), np.isfinite(value)
        best = np.where(known, 2 * np.sqrt(at.half[t] / np.maximum(curved, np.finfo(float).tiny)), LESS * tau)
        size[j, t, side] = best
        wanted[j, t, side] = ~known | ((np.abs(np.log(best / tau)) > BETTER) & (attempt + 1 < SEARCHES))
    return result * np.array([-1.0, 1.0])


class _Work:
    """Evaluates what loads t q beside the others tell of displacements."""

    def __init__(self, certificate: Certificate, fields: Admissible, at: Judged, loads: PointLoads):
        self.certificate, self.fields, self.at, self.loads = certificate, fields, at, loads
        team = certificate.space.team
        self.radius = certificate.radius(fields)
        self.sole = certificate.stage.direction.robin(loads.moved)
        held, = team.sum(dots(loads.moved, self.sole))
        self.strain = loads.energy - held  # ‖M⁻¹q‖²_K
        self.fixed = at.factor > 1  # pressures of Coulomb's friction are to stay
        free, = team.max(max((np.abs(r).max(initial=0.0) for r in loads.resultant), default=0.0))
        self.beyond = at.half - 0.25 * at.squares - at.gap
        self.none = bool(self.fixed and free > 0)

    def __call__(self, j: np.ndarray, t: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(rows,) bounds on |Q(u* − v)| to the side of the sign of t, from load t q of displacement j at load step t, infinite where
        nothing carries it; and about ‖û_t − û‖²/t²."""
        c, at, loads, team = self.certificate, self.at, self.loads, self.certificate.space.team
        carried = [self._forces(*row) for row in zip(j, t, tau)]
        forces, gap, lawful = (np.array(x) for x in zip(*carried))
        gap, = team.sum(gap)
        h = at.change[t] + c.space.loads(c.pairs.transfer.opposed(forces - at.pair.forces[t])[:, : c.space.size])
        q, moved, delta = tau[:, None] * loads.boundary[j], tau[:, None] * loads.moved[j], at.delta[t]
        rest = np.where(lawful[:, None], c.beside.balanced(h + tau[:, None] * self.sole[j]), 0.0)
        known, = team.sum(dots(delta, times(c.stiffness, delta)) - 2 * dots(delta, q + h) + 2 * dots(moved, rest))
        known = known + tau ** 2 * self.strain[j]
        energy, *_ = dual_energy(c.stage, rest, known + 2 * gap, Enough(), softness=c.softness())
        squares = np.maximum(known + energy, 0.0)
        value = (0.25 * squares + gap + self.beyond[t]) / np.abs(tau)
        return np.where(lawful, value, np.inf), np.abs(squares - at.squares[t]) / tau ** 2

    def _forces(self, j: int, t: int, tau: float) -> tuple[np.ndarray, float, bool]:
        """λ̂_t (3, P), this rank's Σγ, and whether they are lawful and in balance."""
        c, at = self.certificate, self.at
        if self.fixed:
            return at.pair.forces[t], at.gap[t] if c.space.team.rank == 0 else 0.0, not self.none
        number, before = c.pairs.numbers[t], at.pair.before[t]
        balanced = c.forces(at.pair.predicted[t], self.fields.f[t], before, number, self.radius, [tau * r[j] for r in self.loads.resultant])
        force = balanced.answer.force
        return force, float(c.pairs.duality_gap(force, at.pair.jump[t], before, number).sum()), not balanced.unbalanced.any()
