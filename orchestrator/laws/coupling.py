"""Coupling: a surface and a point that moves like a rigid body, each of its six motions prescribed
or loaded.

With the rigid motions R of the surface about the point, q their amounts and Q the force and moment
that act there:

    rigid         u = R q                                    on the whole surface
    distributed   q = G⁻¹ Wᵀ u,  f = W G⁻¹ Q,  G = Rᵀ W          the mean motion, and the traction
                                                                 that varies linearly, W = ∫ φ R

Side 2 is the ground, which rests, so that the body moves by u = −d, d = (F − f̂)/keq. A motion j is
prescribed, q_j = g_j, or loaded, Q_j = (Rᵀ f̂)_j = g_j; what is left are at most six equations for
a surface, which the local stage solves:

    rigid         f̂ = F + keq R q,    Q = Rᵀ F + (Rᵀ keq R) q
    distributed   f̂ = W G⁻¹ Q,        q = S Q − G⁻¹ Wᵀ F/keq,    S = G⁻¹ (Wᵀ keq⁻¹ W) G⁻¹
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.base import GroundLaw, Moves
from orchestrator.laws.points import Answer, BONDED, Carries, Collective, Hold, Points, Status

COUPLED = Status(12, "coupled", "#0072B2", Hold.ALWAYS, Hold.ALWAYS)


@dataclass(frozen=True, eq=False)
class CouplingLaw(GroundLaw):
    """A surface that follows a point: it moves with it, or in the mean.

    rigid: u = R q;  distributed: q = G⁻¹ Wᵀ u, f = W G⁻¹ Q;  q or Q given

    motions : (6, 3, n) R: displacement of each node in the three translations of the point and the
        rotations about it
    prescribed : (6,) bool
    given : (6,) amounts of the motions that are prescribed, force and moment of the others
    rigid : whether the surface moves as a rigid body, or so in the mean
    forces : (6, 3, n) W, what tractions R amount to at each node; of no use where it is rigid
    """

    motions: np.ndarray
    prescribed: np.ndarray
    given: np.ndarray
    rigid: bool
    forces: np.ndarray

    name = "coupling"
    # nodes in the middle of edges follow the point like all others
    moves = Moves.RIGID
    statuses = (COUPLED, BONDED)

    @property
    def acts(self) -> bool:
        return bool(np.any(self.given))

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All of a rigid surface whose point is prescribed."""
        count = self.motions.shape[2]
        return (np.repeat(np.eye(3)[:, :, None], count, axis=2),
                np.full((3, count), self.rigid and bool(self.prescribed.all())),
                np.einsum("jcn,j->cn", self.motions, np.where(self.prescribed, self.given, 0.0)))

    @property
    def constrained(self) -> np.ndarray:
        return np.full(self.motions.shape[2], self.rigid)

    def within(self, free: np.ndarray, moved: np.ndarray) -> CouplingLaw | None:
        return self if free.all() else None

    def keeps(self, moved: np.ndarray) -> np.ndarray:
        """(q, m) the prescribed amounts of rigid motions (n, 3, m) of the nodes."""
        R = self.motions.reshape(len(self.motions), -1).T
        return np.linalg.lstsq(R, moved.transpose(1, 0, 2).reshape(len(R), -1),
                               rcond=None)[0][self.prescribed]

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        count = len(chosen)
        return {"motions": self.motions[:, :, chosen],
                "given": np.repeat(self.given[:, None], count, axis=1),
                "prescribed": np.repeat(self.prescribed[:, None], count, axis=1),
                "forces": self.forces[:, :, chosen], "rigid": np.full(count, self.rigid)}

    @staticmethod
    def carries(points: Points) -> Carries:
        """Anything in the motions that are prescribed, and in the others the force and moment that
        are given.
        """
        result, loaded = Carries.anything(len(points)), ~points["prescribed"]
        result.motions = np.where(loaded[:, None], points["motions"], 0.0)
        result.works = np.where(loaded, points["given"], 0.0)
        return result

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂, surface by surface."""
        result, passes = np.empty_like(F), np.zeros(len(points), bool)
        group, at, given, taken = ([] for _ in range(4))
        for index in np.unique(points.interface):
            own = np.flatnonzero(points.interface == index)
            surface = points.some(own)
            rigid = bool(surface["rigid"][0])
            result[:, own], gives, takes = (_rigid if rigid else _distributed)(surface, F[:, own])
            passes[own] = rigid
            for one, other in zip(gives, takes):
                group.append(np.full(len(own), len(group)))
                at.append(own)
                given.append(one)
                taken.append(other)
        answer = Answer(result, np.full(len(points), COUPLED))
        if derivative:
            answer.active = np.flatnonzero(passes)
            answer.derivative = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, len(answer.active)))
            if group:
                answer.collective = Collective(np.concatenate(group), np.concatenate(at),
                                               np.concatenate(given, axis=1),
                                               np.concatenate(taken, axis=1))
        return answer


def _rigid(points: Points, F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f̂ (3, P), and the factors (r, 3, P) of what −∂f̂/∂F has beside −1."""
    R, held, given = points["motions"], points["prescribed"][:, 0], points["given"][:, 0]
    stiff = points.stiffness(R)
    K, q = np.einsum("icp,jcp->ij", R, stiff), np.where(held, given, 0.0)
    free = np.flatnonzero(~held)
    inverse = np.linalg.inv(K[np.ix_(free, free)]) if len(free) else np.zeros((0, 0))
    q[free] = inverse @ (given - np.einsum("icp,cp->i", R, F) - K @ q)[free]
    return F + np.einsum("jcp,j->cp", stiff, q), np.einsum("ij,jcp->icp", inverse,
                                                           stiff[free]), R[free]


def _distributed(points: Points, F: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f̂ (3, P), and factors as of ``_rigid``; nothing of ∂f̂/∂F is local."""
    R, held, given = points["motions"], points["prescribed"][:, 0], points["given"][:, 0]
    W = points["forces"]
    spread = np.einsum("ij,jcp->icp", np.linalg.inv(np.einsum("icp,jcp->ij", R, W)), W)  # G⁻¹ Wᵀ
    moves = points.compliance(spread)
    S, Q = np.einsum("icp,jcp->ij", spread, moves), np.where(held, 0.0, given)
    at = np.flatnonzero(held)
    inverse = np.linalg.inv(S[np.ix_(at, at)]) if len(at) else np.zeros((0, 0))
    Q[at] = inverse @ (given + np.einsum("icp,cp->i", moves, F) - S @ Q)[at]
    return np.einsum("jcp,j->cp", spread, Q), -np.einsum("ij,jcp->icp", inverse,
                                                         spread[at]), moves[at]
