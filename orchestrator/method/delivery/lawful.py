"""Delivered forces where an energy error is known, and the shares of that error.

The forces are λ̂ of ``stopping.certificate``, which the laws allow and which keeps every body in
balance; the displacements are û = u + R y + X, X the bodies' answer to what λ̂ loads them with
beyond the linear stage's forces: one more back-substitution inside. What is not known of X to the
last digit is a load ε on the boundary, far below the error; supports take its resultant, lest a
body's forces add up to anything but nothing.

E² is a sum over bodies and interfaces,

    E² = Σ_bodies ‖v − û‖²_body + 2 Σ_interfaces γ(v, λ̂)

of which a share is a body's own. E is relative to the energy of all bodies together, in which a
soft or a lightly loaded one has next to no say. These are shares of the number that is told, no
bounds of single bodies' errors: what one lacks is strained into its neighbours too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.recovery import answered, on_boundary, Parts
from orchestrator.method.interface.rows import ColumnSegments, dots, times
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.bound import ROUNDING
from orchestrator.method.stopping.certificate import Certificate
from orchestrator.method.stopping.dual_energy import LEFT, Enough, dual_energy
from orchestrator.method.stopping.error_estimate import Judged, relative
from orchestrator.scene.conditions.rigid import motions_about, size_of

HELD = 1e-10  # singular value of held rigid motions, over the largest, that counts as none


@dataclass(frozen=True)
class Lawful:
    """Forces and fields in balance with them, of this rank, T load steps.

    change : (T, B) h, what λ̂ loads the bodies with beyond the linear stage's forces
    x : (T, B) S⁺h, nearly
    parts : û, per subdomain of the scene (T, n_E, 3); None for other ranks'
    f : (T, D) forces on traces, −Bᵀλ̂
    taken : per own subdomain (T, n_E, 3) what supports take of ε, None where there are none
    """

    change: np.ndarray
    x: np.ndarray
    parts: Parts
    f: np.ndarray
    taken: list[np.ndarray | None]

    @classmethod
    def of(cls, d: Decomposition, iterated: Iterated, parts: Parts) -> Lawful | None:
        """Return lawful forces and fields of a solution; None where no energy error is known.

        parts : per subdomain (T, n_E, 3), in equilibrium with the linear stage's forces
        """
        bound = iterated.bound
        if d.certificate is None or not np.isfinite(bound.relative) or bound.pair.missing:
            return None
        h = d.certificate.beside.balanced(d.certificate.change(iterated.fields, bound.pair.forces))
        x = _answered(d.certificate, bound, h)
        if x is None:
            return None
        beyond = answered(d, h + d.stage.direction.robin(x))
        rest = d.stage.direction.robin(x - on_boundary(d, beyond, d.steps))
        own = list(parts)
        for s, more in zip(d.own, beyond):
            own[s.index] = parts[s.index] + more.reshape(parts[s.index].shape)
        f = d.certificate.pairs.transfer.opposed(bound.pair.forces)[:, : d.space.size]
        return cls(h, x, own, f, _taken(d, rest))


def _answered(certificate: Certificate, bound: Judged, h: np.ndarray) -> np.ndarray | None:
    """(T, B) S⁺h, closely if that is possible; None where it is not known."""
    delta = bound.correction
    rest, gap = certificate.space.team.sum(
        dots(delta, times(certificate.stiffness, delta)) - 2 * dots(delta, h), bound.pair.gap)
    worth = np.minimum(rest + 2 * gap, 0.0)
    nothing = (ROUNDING * certificate.stage.loading.size(bound.energy)) ** 2
    # bodies far softer than others may not be known so well
    for share in (certificate.closely, LEFT):
        dual = dual_energy(certificate.stage, h, worth, Enough(nothing, share),
                           softness=certificate.softness(), begun=bound.dual)
        if np.isfinite(dual.energy).all():
            return dual.x
    return None


def _taken(d: Decomposition, rest: np.ndarray) -> list[np.ndarray | None]:
    """Forces on supports with the resultants of ε (T, B), the least ones."""
    result = []
    for s, trace, part in zip(d.own, d.made.traces, d.space.boundary):
        if not s.fixed.any():
            result.append(None)
            continue
        points = d.scene.mesh.nodes[s.nodes]
        motions = motions_about(points, points.mean(axis=0), size_of(points)).reshape(-1, 6)
        held, forces = s.fixed.ravel(), np.zeros((d.steps, 3 * len(s.nodes)))
        forces[:, held] = (rest[:, part] @ motions[trace]) @ np.linalg.pinv(
            motions[held], rcond=HELD)
        result.append(forces.reshape(d.steps, -1, 3))
    return result


@dataclass(frozen=True)
class Shares:
    """Shares of the error at the load step where it is largest; the largest first.

    step : that load step, from 0
    bodies, interfaces : name → share of E²
    own : body → √ of what is its own, over its own energy norm, the largest of all load steps each;
        infinite where that is no more. Of bodies whose matter is the scene's, and whose error is
        more than rounding
    """

    step: int
    bodies: dict[str, float]
    interfaces: dict[str, float]
    own: dict[str, float]


def shares(d: Decomposition, bound: Judged, lawful: Lawful, energy: np.ndarray) -> Shares:
    """Return the shares of a run whose energy error is known.

    energy : (T, subdomains) ‖u‖²_K of all ranks, of those whose matter is the scene's
    """
    space, pairs, pair, delta = d.space, d.certificate.pairs, bound.pair, bound.correction
    of, change, interfaces = ColumnSegments(space.boundary), lawful.change, d.scene.interfaces
    each, gaps = (np.zeros((d.steps, len(x))) for x in (d.scene.subdomains, interfaces))
    strain = times(d.certificate.stiffness, delta)
    found = of.sums(delta * (strain - 2 * change) + change * lawful.x)
    each[:, np.asarray(space.subdomains)[of.subdomains]] = np.maximum(found, 0.0)
    for t, number in enumerate(pairs.numbers):
        gap = pairs.duality_gap(pair.forces[t], pair.jump[t], pair.before[t], number)
        for i, at in pairs.each():
            gaps[t, i.index] += 2 * gap[at].sum()
    each, gaps = space.team.sum(each, gaps)
    names, body = np.unique([s.body for s in d.scene.subdomains], return_inverse=True)
    each, energy = (np.array([np.bincount(body, row, len(names)) for row in rows])
                    for rows in (each, energy))
    gaps = np.maximum(gaps, 0.0)
    whole = each.sum(axis=1) + gaps.sum(axis=1)
    step, least = int(whole.argmax()), ROUNDING * np.sqrt(energy.sum(axis=1).max())
    foreign = [d.blackbox.traits(s.code).own_matter for s in d.scene.subdomains] | d.scene.stand_ins
    known = np.bincount(body, foreign, len(names)) == 0
    far, strained = np.sqrt(each.max(axis=0)), np.sqrt(energy.max(axis=0))
    own = {str(names[k]): relative(float(far[k]), float(strained[k]))
           for k in np.flatnonzero(known & (far > least))}
    total = max(float(whole[step]), np.finfo(float).tiny)
    return Shares(step, _largest(names, each[step] / total),
                  _largest([i.name for i in interfaces], gaps[step] / total),
                  dict(sorted(own.items(), key=lambda item: -item[1])))


def _largest(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    largest = np.argsort(-values, kind="stable")
    return {str(names[k]): float(values[k]) for k in largest if values[k] > 0}
