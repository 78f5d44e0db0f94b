"""Support: what a rigid ground does to a body through springs, or by holding some directions, point
by point.

With the directions e_i of a point, stiffnesses k_i per area from 0 (free) to infinity (held), and
displacements g_i that are prescribed along them, the force on side 1, the body, is f̂ = Σ e_i φ_i.
Side 2 is the ground, which rests, so that the body moves by −d:

    φ_i / (k_i A) = g_i + d·e_i,    d = C (F − f̂),  C = 1/keq:
    (Eᵀ C E + diag 1/(k_i A)) φ = Eᵀ C F + g
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.laws.base import GroundLaw, Moves
from orchestrator.laws.points import Answer, BONDED, Carries, Hold, Points, Status
from orchestrator.linalg import WRITTEN

SUPPORTED = Status(13, "supported", "#CC79A7", Hold.ALWAYS, Hold.ALWAYS)
GUIDED = Status(14, "guided", "#56B4E9", Hold.ALWAYS, Hold.NEVER)
CARRIED = Status(15, "carried along", "#F0E442", Hold.NEVER, Hold.ALWAYS)
# cosine between a direction and the normal, from which it is what keeps bodies from moving along
# the normal
UPRIGHT = 0.99


@dataclass(frozen=True, eq=False)
class Support(GroundLaw):
    """A rigid ground, at n nodes: springs, or directions that are held.

    f·e = k A (g − u·e), or u·e = g, in directions e

    frame : (3, 3, n) directions, at [which, component, node], of length one, or shorter where
        components are prescribed
    stiffness : (3, n) k_i, infinite where held, 0 where free
    given : (3, n) displacements of the body along them
    normal : (3, n) unit normals, for what is said of them
    """

    frame: np.ndarray
    stiffness: np.ndarray
    given: np.ndarray
    normal: np.ndarray

    name = "support"
    # nodes in the middle of edges stand on the ground too: nothing presses, so that nothing has to
    # be kept plane
    moves = Moves.GIVEN
    statuses = (SUPPORTED, GUIDED, CARRIED, BONDED)

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.frame, np.isinf(self.stiffness), self.given

    @property
    def constrained(self) -> np.ndarray:
        return np.isinf(self.stiffness).any(axis=0)

    def within(self, free: np.ndarray, moved: np.ndarray) -> Support:
        """Of a direction that lies in the others but for rounding nothing is left."""
        frame = np.where(free.T, self.frame, 0.0)
        frame = np.where(np.linalg.norm(frame, axis=1, keepdims=True) > WRITTEN, frame, 0.0)
        return replace(self, frame=frame, given=self.given
                       - np.einsum("icn,nc->in", self.frame, moved))

    def keeps(self, moved: np.ndarray) -> np.ndarray:
        return np.einsum("icn,ncm->nim", self.frame, moved)[(self.stiffness > 0).T]

    def parameters(self, chosen: np.ndarray, length: np.ndarray,
                   area: np.ndarray) -> dict[str, np.ndarray]:
        k = self.stiffness[:, chosen] * area
        acts = (k > 0) & (np.linalg.norm(self.frame[:, :, chosen], axis=1) > 0)
        along = np.abs(np.einsum("icp,cp->ip", self.frame[:, :, chosen],
                                 self.normal[:, chosen])) > UPRIGHT
        held = (acts & along).any(axis=0)
        across = (acts & ~along).sum(axis=0) > 1
        return {"frame": self.frame[:, :, chosen], "acts": acts,
                "softness": 1 / np.where(acts, k, 1.0), "given": self.given[:, chosen],
                "status": np.where(held & across, SUPPORTED, np.where(held, GUIDED, CARRIED))}

    @staticmethod
    def carries(points: Points) -> Carries:
        """Anything in the directions that are held or sprung."""
        result = Carries.anything(len(points))
        result.directions = np.where(points["acts"][:, None], points["frame"], 0.0)
        return result

    @staticmethod
    def duality_gap(points: Points, force: np.ndarray, jump: np.ndarray,
                    previous: np.ndarray) -> np.ndarray:
        """½ Σ (φ/k − g − d·e)² k of the springs: what is held has no price."""
        acts, softness = points["acts"], points["softness"]
        E = np.where(acts[:, None], points["frame"], 0.0)
        matrix = np.linalg.pinv(np.einsum("icp,jcp->pij", E, E), hermitian=True)
        phi = np.einsum("pij,jcp,cp->ip", matrix, E, force)
        apart = softness * phi - points["given"] - np.einsum("icp,cp->ip", E, jump)
        sprung = acts & (softness > 0)
        return 0.5 * np.sum(np.where(sprung, apart**2 / np.where(sprung, softness, 1.0), 0.0),
                            axis=0)

    @staticmethod
    def force(points: Points, F: np.ndarray, previous: np.ndarray,
              derivative: bool = False) -> Answer:
        """f̂ = E φ."""
        acts = points["acts"]
        E = np.where(acts[:, None], points["frame"], 0.0)
        CE = points.compliance(E)  # (3 directions, 3, P)
        matrix = np.einsum("icp,jcp->pij", E, CE)
        each = np.arange(3)
        matrix[:, each, each] += np.where(acts, points["softness"], 1.0).T
        right = np.einsum("icp,cp->pi", CE, F) + np.where(acts, points["given"], 0.0).T
        # directions that share what is left of them where components are prescribed may depend on
        # each other
        inverse = np.linalg.pinv(matrix,
                                 hermitian=True) if (np.linalg.norm(E, axis=1)[acts] < 1
                                                     - 1e-9).any() else np.linalg.inv(matrix)
        phi = np.einsum("pij,pj->ip", inverse, right)
        answer = Answer(np.einsum("icp,ip->cp", E, phi), points["status"])
        if derivative:
            answer.active = np.arange(len(points))
            answer.derivative = np.ascontiguousarray(np.einsum("iap,pij,jbp->abp", E, inverse, CE))
        return answer
