"""Delivered forces where an energy error is known: λ̂, which the laws allow and which keeps every body in balance, and û.

û is u + R y + X, X the bodies' answer to what λ̂ loads them with beyond the linear stage's forces: one more back-substitution inside. What
is not known of X to the last digit is a load ε on the boundary, far below the error; supports take its resultant, lest a body's forces add
up to anything but nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.recovery import Parts, on_boundary
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.certificate import Certificate, pushed
from orchestrator.method.stopping.judged import Judged, judged
from orchestrator.scene.conditions.rigid import motions_about, size_of

HELD = 1e-10  # singular value of held rigid motions, over the largest, that counts as none


@dataclass(frozen=True)
class Lawful:
    """Forces and fields in balance with them, of this rank, T load steps.

    certificate, judged : where they come from
    parts : û, per subdomain of the scene (T, n_E, 3); None for other ranks'
    f : (T, D) forces on traces, −Bᵀλ̂
    taken : per own subdomain (T, n_E, 3) what supports take of ε, None where there are none
    beyond : per own subdomain (T, 3 n_E) X; rest : (T, B) ε
    """

    certificate: Certificate
    judged: Judged
    parts: Parts
    f: np.ndarray
    taken: list[np.ndarray | None]
    beyond: list[np.ndarray]
    rest: np.ndarray

    @classmethod
    def of(cls, d: Decomposition, iterated: Iterated, parts: Parts, wanted: bool = False) -> Lawful | None:
        """Lawful forces and fields of a solution; None where no energy error is known, or laws are perfect and nobody wants them.

        parts : per subdomain (T, n_E, 3), in equilibrium with the linear stage's forces
        """
        certificate = certificate_of(d) if wanted and d.all_perfect else d.certificate
        if certificate is None or not np.isfinite(iterated.bound.relative):
            return None
        u = on_boundary(d, [parts[s.index] for s in d.own], d.steps)
        at = judged(certificate, iterated.fields, iterated.bound, u, d.bound.floor if d.all_perfect else 0.0)
        if at is None:
            return None
        beyond, rest = _answers(d, at)
        own = list(parts)
        for s, more in zip(d.own, beyond):
            own[s.index] = parts[s.index] + more.reshape(parts[s.index].shape)
        f = certificate.pairs.transfer.opposed(at.pair.forces)[:, : d.space.size]
        return cls(certificate, at, own, f, _taken(d, rest), beyond, rest)


def certificate_of(d: Decomposition) -> Certificate:
    """The certificate of perfect interfaces."""
    from orchestrator.method.interface.pairing import make_pairs

    pairs = make_pairs(d.scene, d.space, d.stage.direction.whole)
    return Certificate(pairs, d.bound.stiffness, [m[t] for m, t in zip(d.made.modes, d.made.traces)], d.bound.external, d.stage,
                       pushed(d.own, d.made.modes))


def _answers(d: Decomposition, at: Judged) -> tuple[list[np.ndarray], np.ndarray]:
    """Per own subdomain (T, 3 n_E) X, and (T, B) ε."""
    forces, requests, found = at.change + d.stage.direction.robin(at.x), {}, []
    for e, (trace, part) in enumerate(zip(d.made.traces, d.space.boundary)):
        if forces[:, part].any():
            requests[e] = np.zeros((d.steps, 3 * d.made.node_counts[e]))
            requests[e][:, trace] = forces[:, part]
    answers, boundary = d.blackbox.fields(requests), np.zeros_like(at.x)
    for e, (s, trace, part) in enumerate(zip(d.own, d.made.traces, d.space.boundary)):
        found.append(answers[e][:, : 3 * len(s.nodes)] if e in answers else np.zeros((d.steps, 3 * len(s.nodes))))
        boundary[:, part] = found[-1][:, trace]
    return found, d.stage.direction.robin(at.x - boundary)


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
        forces[:, held] = (rest[:, part] @ motions[trace]) @ np.linalg.pinv(motions[held], rcond=HELD)
        result.append(forces.reshape(d.steps, -1, 3))
    return result
