"""Settling: one body of the coarse contact problem, moved alone until its forces balance.

A body that little holds has almost no stiffness, up to the place where something stops it. Newton's method
cannot see that far; the body can slide there. Overdamped, dv/dt = −ρ(v), with implicit steps that grow
as the imbalance falls (pseudo-transient continuation, Kelley & Keyes, SIAM J. Numer. Anal. 35, 1998),

    (J + 1/Δt) dv = −ρ

The other bodies stay where they are, so that a step costs the laws of this body's own pairs and a n × n system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.interface.pairs import History, Pairs

STEPS = 120
FIRST = 1e4  # pseudo-time step to begin with; stiffnesses are of order one in units of k
GROWTH = 1.2  # of the steps even if the imbalance does not fall
FASTEST = 2.0
JUMP = 3.0  # growth of the imbalance in one step that is not accepted


@dataclass
class Body:
    """One body of a coarse contact problem.

    pairs : the Q node pairs of its interfaces; chosen : (Q,) int, where they are among all
    T, L : (Q, 3, n) its fields at these pairs and their response, as in ``coarse``
    K : (n, n) stiffness of its fields
    W : (t, n) displacement of its traces in them
    """

    pairs: Pairs
    chosen: np.ndarray
    T: np.ndarray
    L: np.ndarray
    K: np.ndarray
    W: np.ndarray

    def settle(self, F: np.ndarray, before: History, number: int, rho: np.ndarray, goal: float, radius: float) -> np.ndarray:
        """(n,) change of the body's fields that brings the size of its ρ to ``goal``, or as far as it may go.

        F : (3, P) predicted forces; before : what the load step before has left, of all pairs
        number : of the load step in the scene
        rho : (n,) imbalance of the body there
        radius : longest move
        """
        start, before = F[:, self.chosen], before.take(self.chosen)
        carried = rho + self._sum(self.pairs.force(start, before, number).force)
        v, best = np.zeros(len(rho)), np.zeros(len(rho))
        F, size, least, step = start, np.linalg.norm(rho), np.linalg.norm(rho), FIRST
        slope = None
        for _ in range(STEPS):
            if size <= goal:
                break
            if slope is None:
                slope = self._slope(F, before, number)
            dv = np.linalg.solve(slope + np.eye(len(rho)) / step, -rho)
            left = radius - np.abs(self.W @ v).max(initial=0.0)
            far = np.abs(self.W @ dv).max(initial=0.0) > left
            if far:
                dv *= left / np.abs(self.W @ dv).max()
            F_new = start + (self.L @ (v + dv)).T
            rho_new = carried + self.K @ (v + dv) - self._sum(self.pairs.force(F_new, before, number).force)
            size_new = np.linalg.norm(rho_new)
            if not size_new <= JUMP * size and step > 1 / FIRST:
                step /= 4
                continue
            step *= GROWTH * min(size / max(size_new, np.finfo(float).tiny), FASTEST)
            v, F, rho, size, slope = v + dv, F_new, rho_new, size_new, None
            if far:
                return v
            if size < least:
                best, least = v, size
        return best

    def _sum(self, force: np.ndarray) -> np.ndarray:
        """(n,) Tᵀ of forces (3, Q)."""
        return np.tensordot(self.T, force, axes=((1, 0), (0, 1)))

    def _slope(self, F: np.ndarray, before: History, number: int) -> np.ndarray:
        """(n, n) derivative of ρ."""
        answer = self.pairs.force(F, before, number, derivative=True)
        slope = self.K - np.tensordot(self.T[answer.active], answer.derivative.transpose(2, 0, 1) @ self.L[answer.active],
                                      axes=((0, 1), (0, 1)))
        if answer.collective is not None:
            for at, given, taken in answer.collective.groups():
                slope += np.outer(np.einsum("pif,ip->f", self.T[at], given), np.einsum("ip,pif->f", taken, self.L[at]))
        return slope
