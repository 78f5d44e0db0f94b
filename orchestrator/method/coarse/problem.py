"""The coarse contact problem of one load step: 12 fields per body, the true laws at every node pair.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y) = 0

It is solved by a semismooth Newton. A Levenberg term makes it robust; a body that hardly anything holds, which
no Newton step brings to rest, is settled alone (``settling``), no further than the radius in one solve: bodies
come to rest over several iterations of the method, and their neighbours follow.

Most pairs are open and stay so. With |n·L y| ≤ ‖n·L‖ ‖y‖, those that no fields of the size seen so far can close
are left out, and come back if the fields grow beyond it.

Among ranks, what belongs to a body is formed by its rank, what belongs to an interface by the rank of its first
side. ρ is summed, every Newton matrix goes to rank 0, which solves for all: right for some thousands of bodies.
"""

from __future__ import annotations

import numpy as np

from orchestrator.method.coarse.block_pattern import BlockPattern
from orchestrator.method.coarse.pair_fields import FIELDS, PairFields
from orchestrator.method.coarse.settling import Body
from orchestrator.method.coarse.stale_factors import StaleFactors
from orchestrator.parallel.team import Team

REDUCTION = 1e-2  # a coarse problem need not be solved better than the iteration it serves
SLOW, IDLE = 0.9, 2  # two steps that gain less than a tenth each have a body settle, or end a solve,
SERVED, STILL = 0.1, 0.99  # if it has been reduced that much already, or an accepted step gained next to nothing
MAX_STEPS = 20
FLAT = 1.001  # growth of ρ that still counts as standing still
LEVENBERG = 1e-4  # first shift of the Newton matrix, relative to k; raised where a step fails
DOMINATING, FEW = 0.5, 2  # a body with more of ρ is settled alone when Newton's method stands still; at most so many
SETTLED = 0.05  # of what the whole is solved to, for one body alone
REACH = 2.0  # size of the fields that pairs must be able to close at, over the size last seen


class _Step:
    """One load step: ρ, and the pairs near enough to matter.

    Parameters
    ----------
    problem : of all load steps
    F0 : (3, P) predicted forces
    resultant : (bodies, 12) Uᵀf
    previous : (3, P) jump at the end of the load step before
    reach : (I,) size of the two bodies' fields up to which the pairs left out cannot close; grows if need be
    """

    def __init__(self, problem: CoarseProblem, F0: np.ndarray, resultant: np.ndarray, previous: np.ndarray,
                 reach: np.ndarray):
        self.problem, self.F0, self.resultant, self.previous, self.reach = problem, F0, resultant, previous, reach
        self.seen = np.zeros_like(reach)
        self._choose()

    def _choose(self) -> None:
        fields = self.problem.fields
        if np.isfinite(self.reach).all():
            change = fields.normal_size * np.repeat(self.reach, np.diff(fields.pairs.bounds))
            near = np.flatnonzero(~fields.pairs.idle(self.F0, change))
            self.fields = fields.some(near)
            self.F0_near, self.before = self.F0.take(near, axis=1), self.previous.take(near, axis=1)
        else:
            self.fields, self.F0_near, self.before = fields, self.F0, self.previous

    def residual(self, y: np.ndarray) -> np.ndarray:
        """(bodies, 12) ρ; the forces that it was formed with are kept for ``matrix``."""
        size = np.linalg.norm(self.fields.both(y), axis=1)
        self.seen = np.maximum(self.seen, size)
        if (size > self.reach).any():
            self.reach = np.maximum(self.reach, REACH * self.seen)
            self._choose()
        problem = self.problem
        self.F = self.F0_near + self.fields.spread(y)
        sums = self.fields.carried(self.fields.pairs.force(self.F, self.before).force)[problem.counted]
        carried = np.zeros((problem.bodies, FIELDS))
        np.add.at(carried, problem.firsts[problem.counted], sums[:, :FIELDS])
        np.add.at(carried, problem.seconds[problem.counted], sums[:, FIELDS:])
        carried, = problem.team.sum(carried)
        return self.resultant + np.einsum("bij,bj->bi", problem.K0, y) - carried

    def matrix(self) -> np.ndarray | bool:
        """Values of K₀ − ΣTᵀA L at the last forces, for the pattern, where that is."""
        problem = self.problem
        answer = self.fields.pairs.force(self.F, self.before, derivative=True)
        everyone = problem.team.gather(self.fields.slopes(answer)[problem.counted])
        return problem.pattern.values(-np.concatenate(everyone)[problem.order], problem.K0) if everyone else False


class CoarseProblem:
    """The coarse contact problem, for any load step.

    Parameters
    ----------
    team : the ranks
    bodies, own : their number; (b,) int, those of this rank
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, 12, 12) stiffness of the fields
    W : per own body (t, 12), displacement of its traces in the fields

    Attributes
    ----------
    newton_steps : Newton steps taken so far
    """

    def __init__(self, team: Team, bodies: int, own: np.ndarray, fields: PairFields, K0: np.ndarray,
                 W: list[np.ndarray]):
        self.team, self.bodies, self.own, self.fields = team, bodies, np.asarray(own, dtype=int), fields
        self.K0, self.W, pairs = K0, W, fields.pairs
        self.firsts, self.seconds = fields.bodies.T
        self.counted = np.flatnonzero(np.isin(self.firsts, own))  # interfaces that this rank adds up
        counted = [pairs.interfaces[i] for i in self.counted]
        everyones = sum(team.all_gather([(i.index, *i.subdomains) for i in counted]), [])
        # the order in which blocks are added must not depend on the ranks
        self.order = np.array(sorted(range(len(everyones)), key=everyones.__getitem__), dtype=int)
        ends = np.array([everyones[i][1:] for i in self.order], dtype=int).reshape(-1, 2)
        self.pattern = BlockPattern(ends, bodies, FIELDS) if team.rank == 0 else None
        self.factors = StaleFactors(self.pattern) if team.rank == 0 else None
        self.farthest = np.array([np.linalg.norm(w, axis=1).max(initial=0.0) for w in W])
        self.newton_steps = 0
        self._reach: dict[int, np.ndarray] = {}
        self._alone: dict[int, Body] = {}

    def solve(self, step: int, F0: np.ndarray, resultant: np.ndarray, previous: np.ndarray,
              radius: float) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, 12) y of one load step, and (3, P) F = F₀ + L y.

        Parameters
        ----------
        step : number of the load step: what it needed is remembered for the next iteration
        F0 : (3, P) predicted forces
        resultant : (bodies, 12) Uᵀf
        previous : (3, P) jump at the end of the load step before
        radius : longest move of a body in one Newton step
        """
        at = _Step(self, F0, resultant, previous, self._reach.get(step, np.full(len(self.firsts), np.inf)))
        y = np.zeros((self.bodies, FIELDS))
        rho = at.residual(y)
        size = start = np.linalg.norm(rho)
        delta, matrix, idling, before, still, settled = LEVENBERG, None, 0, np.inf, False, []
        for _ in range(MAX_STEPS):
            idling, before = (idling + 1 if size > SLOW * before else 0), size
            if size <= REDUCTION * start or size == 0:
                break
            if idling >= IDLE:
                worst = self._dominating(rho, size)
                if worst is not None and worst not in settled and len(settled) < FEW:
                    settled.append(worst)
                    F, goal = F0 + self.fields.spread(y), SETTLED * REDUCTION * start
                    y = y + self._settle(worst, F, previous, rho, goal, radius)
                    rho = at.residual(y)
                    size, delta, matrix, idling, before = np.linalg.norm(rho), LEVENBERG, None, 0, np.inf
                elif size <= SERVED * start or still:
                    break
            self.newton_steps += 1
            if matrix is None:
                matrix = at.matrix()
            dy = self.team.share(-self.factors.solve(step, matrix, rho, delta) if self.factors else None)
            dy = self._clipped(dy, radius)
            for theta in (1.0, 0.5, 0.25):
                trial = y + theta * dy
                rho_new = at.residual(trial)
                size_new = np.linalg.norm(rho_new)
                # a loose body feels nothing until it touches: once the shift is raised, standing still is allowed
                idle = theta == 1 and delta > LEVENBERG and size_new <= FLAT * size
                if size_new <= (1 - 0.2 * theta) * size or idle:
                    still = size_new > STILL * size
                    y, rho, size, matrix = trial, rho_new, size_new, None
                    break
            else:
                still = False
                delta *= 30
                if delta > 1e3:
                    break
        self._reach[step] = REACH * at.seen
        return y, F0 + self.fields.spread(y)

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
        bounds = self.fields.pairs.bounds
        first = np.repeat(self.firsts == body, np.diff(bounds))
        chosen = np.flatnonzero(first | np.repeat(self.seconds == body, np.diff(bounds)))
        first, fields = first[chosen, None, None], self.fields.some(chosen)
        T, L = (np.where(first, x[:, :, :FIELDS], x[:, :, FIELDS:]) for x in (fields.at_pairs(), fields.L))
        return Body(fields.pairs, chosen, T, L, self.K0[body], W)

    def _clipped(self, dy: np.ndarray, radius: float) -> np.ndarray:
        """A body that nothing touches has no stiffness to stop it: no step moves a body by more than the radius."""
        move = self.farthest * np.linalg.norm(dy[self.own], axis=1)
        for e in np.flatnonzero(move > radius):  # the others cannot, by Cauchy and Schwarz
            move[e] = np.abs(self.W[e] @ dy[self.own[e]]).max(initial=0.0)
        return dy * (radius / np.maximum(of_all(self.team, self.bodies, self.own, move), radius))[:, None]


def of_all(team: Team, bodies: int, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(bodies, …) from what each rank knows of its own bodies."""
    everything = np.zeros((bodies, *values.shape[1:]))
    everything[own] = values
    return team.sum(everything)[0]
