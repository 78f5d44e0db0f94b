"""The coarse contact problem of one load step: 12 fields per body, the true laws at every node pair.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y) = 0

It is solved by a semismooth Newton. A Levenberg term makes it robust; a body that hardly anything holds, which
no Newton step brings to rest, is settled alone (``settling``), no further than the radius in one solve: bodies
come to rest over several iterations of the method, and their neighbours follow.

Among ranks, what belongs to a body is formed by its rank, what belongs to an interface by the rank of its first
side. ρ is summed, every Newton matrix goes to rank 0, which solves for all: right for some thousands of bodies.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.block_pattern import BlockPattern
from orchestrator.method.pairs import Pairs
from orchestrator.method.settling import Body
from orchestrator.parallel.team import Team

FIELDS = 12
REDUCTION = 1e-2  # a coarse problem need not be solved better than the iteration it serves
SERVED, SLOW, IDLE = 0.1, 0.9, 2  # reduced this much, a solve ends after two steps that gain less than a tenth
MAX_STEPS = 20
FLAT = 1.001  # growth of ρ that still counts as standing still
LEVENBERG = 1e-4  # first shift of the Newton matrix, relative to k; raised where a step fails
DOMINATING, FEW = 0.5, 2  # a body with more of ρ is settled alone when Newton's method stands still; at most so many
SETTLED = 0.05  # of what the whole is solved to, for one body alone


class CoarseProblem:
    """The coarse contact problem, for any load step.

    Parameters
    ----------
    team : the ranks
    bodies, own : their number; (b,) int, those of this rank
    pairs : the P node pairs of all interfaces that this rank touches
    T, L : (P, 3, 24) fields of the first body and then of the second at the pairs, and what F changes with them
    K0 : (bodies, 12, 12) stiffness of the fields
    W : per own body (t, 12), displacement of its traces in the fields

    Attributes
    ----------
    newton_steps : Newton steps taken so far
    """

    def __init__(self, team: Team, bodies: int, own: np.ndarray, pairs: Pairs, T: np.ndarray, L: np.ndarray,
                 K0: np.ndarray, W: list[np.ndarray]):
        self.team, self.bodies, self.own, self.pairs = team, bodies, np.asarray(own, dtype=int), pairs
        self.T, self.L, self.K0, self.W = T, L, K0, W
        # a Newton matrix need not be more accurate than the step it is good for
        self.T_single, self.L_single = T.astype(np.float32), L.astype(np.float32)
        self.counts, self.ends = np.diff(pairs.bounds), 3 * pairs.bounds
        self.firsts, self.seconds = np.array([i.subdomains for i in pairs.interfaces], dtype=int).reshape(-1, 2).T
        self.counted = np.flatnonzero(np.isin(self.firsts, own))  # interfaces that this rank adds up
        counted = [pairs.interfaces[i] for i in self.counted]
        everyones = sum(team.all_gather([(i.law, i.index, *i.subdomains) for i in counted]), [])
        # the order in which blocks are added must not depend on the ranks: single precision shows it
        self.order = np.array(sorted(range(len(everyones)), key=everyones.__getitem__), dtype=int)
        ends = np.array([everyones[i][2:] for i in self.order], dtype=int).reshape(-1, 2)
        self.pattern = BlockPattern(ends, bodies, FIELDS) if team.rank == 0 else None
        self.newton_steps = 0
        self._alone: dict[int, Body] = {}

    def solve(self, F0: np.ndarray, resultant: np.ndarray, previous: np.ndarray,
              radius: float) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, 12) y of one load step, and (P, 3) F = F₀ + L y.

        Parameters
        ----------
        F0 : (P, 3) predicted forces
        resultant : (bodies, 12) Uᵀf
        previous : (P, 3) jump at the end of the load step before
        radius : longest move of a body in one Newton step
        """
        y, F = np.zeros((self.bodies, FIELDS)), F0
        rho = self._residual(y, F, resultant, previous)
        size = start = np.linalg.norm(rho)
        delta, matrix, idling, before, settled = LEVENBERG, None, 0, np.inf, []
        for _ in range(MAX_STEPS):
            idling, before = (idling + 1 if size > SLOW * before else 0), size
            if size <= REDUCTION * start or size == 0:
                break
            if idling >= IDLE:
                worst = self._dominating(rho, size)
                if worst is not None and worst not in settled and len(settled) < FEW:
                    settled.append(worst)
                    alone = self._settle(worst, F, previous, rho, SETTLED * REDUCTION * start, radius)
                    y, F = y + alone, F + self._spread(alone)
                    rho = self._residual(y, F, resultant, previous)
                    size, delta, matrix, idling, before = np.linalg.norm(rho), LEVENBERG, None, 0, np.inf
                elif size <= SERVED * start:
                    break
            self.newton_steps += 1
            if matrix is None:
                matrix = self._matrix(F, previous)
            dy = self.team.share(-self.pattern.solve(matrix, rho, delta) if self.pattern else None)
            dy = self._clipped(dy, radius)
            dF = self._spread(dy)
            for theta in (1.0, 0.5, 0.25):
                trial, F_new = y + theta * dy, F + theta * dF
                rho_new = self._residual(trial, F_new, resultant, previous)
                size_new = np.linalg.norm(rho_new)
                # a loose body feels nothing until it touches: once the shift is raised, standing still is allowed
                idle = theta == 1 and delta > LEVENBERG and size_new <= FLAT * size
                if size_new <= (1 - 0.2 * theta) * size or idle:
                    y, F, rho, size, matrix = trial, F_new, rho_new, size_new, None
                    break
            else:
                delta *= 30
                if delta > 1e3:
                    break
        return y, F

    def _dominating(self, rho: np.ndarray, size: float) -> int | None:
        """The body that most of ρ belongs to, if there is one."""
        each = np.linalg.norm(rho, axis=1)
        return int(each.argmax()) if each.max() > DOMINATING * size else None

    def _settle(self, body: int, F: np.ndarray, previous: np.ndarray, rho: np.ndarray, goal: float,
                radius: float) -> np.ndarray:
        """(bodies, 12) y of one body that settles while the others rest; its rank knows all its pairs."""
        change = np.zeros((len(self.own), FIELDS))
        for e in np.flatnonzero(self.own == body):
            if body not in self._alone:
                self._alone[body] = self._body(body, self.W[e])
            change[e] = self._alone[body].settle(F, previous, rho[body], goal, radius)
        return of_all(self.team, self.bodies, self.own, change)

    def _body(self, body: int, W: np.ndarray) -> Body:
        mine = np.flatnonzero((self.firsts == body) | (self.seconds == body))
        pairs, chosen = self.pairs.of(mine)
        first = np.repeat(self.firsts[mine] == body, self.counts[mine])[:, None, None]
        T, L = (np.where(first, x[chosen, :, :FIELDS], x[chosen, :, FIELDS:]) for x in (self.T, self.L))
        return Body(pairs, chosen, T, L, self.K0[body], W)

    def _clipped(self, dy: np.ndarray, radius: float) -> np.ndarray:
        """A body that nothing touches has no stiffness to stop it: no step moves a body by more than the radius."""
        move = np.array([np.abs(W @ dy[e]).max(initial=0.0) for e, W in zip(self.own, self.W)])
        return dy * (radius / np.maximum(of_all(self.team, self.bodies, self.own, move), radius))[:, None]

    def _residual(self, y: np.ndarray, F: np.ndarray, resultant: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """(bodies, 12) ρ, for F = F₀ + L y."""
        force = self.pairs.force(F, previous).force
        flat, T, ends = force.ravel(), self.T.reshape(-1, 2 * FIELDS), self.ends
        sums = np.array([flat[ends[i] : ends[i + 1]] @ T[ends[i] : ends[i + 1]] for i in self.counted])
        sums = sums.reshape(-1, 2, FIELDS)
        carried = np.zeros((self.bodies, FIELDS))
        np.add.at(carried, self.firsts[self.counted], sums[:, 0])
        np.add.at(carried, self.seconds[self.counted], sums[:, 1])
        carried, = self.team.sum(carried)
        return resultant + np.einsum("bij,bj->bi", self.K0, y) - carried

    def _spread(self, y: np.ndarray) -> np.ndarray:
        """(P, 3) L y."""
        both = np.concatenate([y[self.firsts], y[self.seconds]], axis=1)
        L = self.L.reshape(-1, 2 * FIELDS)
        if not len(L):
            return np.zeros((0, 3))
        return np.concatenate([L[a:b] @ v for a, b, v in zip(self.ends[:-1], self.ends[1:], both)]).reshape(-1, 3)

    def _matrix(self, F: np.ndarray, previous: np.ndarray) -> np.ndarray | bool:
        """Values of K₀ − ΣTᵀA L, for ``pattern``, where that is; only pairs that carry a force contribute."""
        answer = self.pairs.force(F, previous, derivative=True)
        active = answer.active
        T = self.T_single[active].reshape(-1, 2 * FIELDS)
        AL = (answer.derivative.astype(np.float32) @ self.L_single[active]).reshape(-1, 2 * FIELDS)
        ends = 3 * np.searchsorted(active, self.pairs.bounds)
        blocks = np.zeros((len(self.counted), 2 * FIELDS, 2 * FIELDS), np.float32)
        for block, a, b in zip(blocks, ends[self.counted], ends[self.counted + 1]):
            if b > a:
                np.matmul(T[a:b].T, AL[a:b], out=block)
        everyone = self.team.gather(blocks)
        return self.pattern.values(-np.concatenate(everyone)[self.order], self.K0) if everyone else False

def of_all(team: Team, bodies: int, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(bodies, …) from what each rank knows of its own bodies."""
    everything = np.zeros((bodies, *values.shape[1:]))
    everything[own] = values
    return team.sum(everything)[0]
