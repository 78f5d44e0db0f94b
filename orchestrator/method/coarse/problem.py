"""The coarse contact problem: n = 12 fields per body, or 6, the true laws at every node pair, load step by load step.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y) = 0

``newton`` solves it. Where contacts are stabilised every body has a place, and it finds that. Elsewhere a body that hardly
anything holds moves no further than the radius in a step: such bodies come to rest over several iterations of the method.

Among ranks, what belongs to a body is formed by its rank; every Newton matrix goes to rank 0, which solves for all:
right for some thousands of bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

import numpy as np

from orchestrator.method.coarse.load_step import Bodies, LoadStep
from orchestrator.method.coarse.newton import Newton
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.parallel.team import Team

REDUCTION = 1e-2  # it need not be solved better than the iteration it serves
# The same where contacts are stabilised, as ρ tells little of where loose bodies are: 125 grains of seed 2 take 51 iterations, 64 with
# 1e-3 and 83 with 1e-2.
FINELY = 1e-4
MOST_STEPS = 60  # every body has a place, where contacts are stabilised, and it pays to find it


class CoarseProblem:
    """The coarse contact problem, for any load step.

    team : the ranks
    own : (b,) int, the bodies of this rank
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, n, n) stiffness of the fields
    W : per own body (t, n), displacement of its traces in the fields
    reduction, goal : of ‖ρ‖ at the start, and in its own unit, to which a load step is solved
    newton_steps : Newton steps taken so far
    ends : how solves have ended so far → how many: "tolerance", or why not there: "stalled", "steps" (as many
        as are allowed), "no direction" (whatever the shift)
    left : per load step, ‖ρ‖ that its last solve left, over that at its start
    """

    def __init__(self, team: Team, own: np.ndarray, fields: PairFields, K0: np.ndarray, W: list[np.ndarray]):
        self.team, self.own, self.fields, self.W = team, np.asarray(own, dtype=int), fields, W
        self.bodies = Bodies.of(team, self.own, fields, K0)
        self.farthest = self._of_all(np.array([np.linalg.norm(w, axis=1).max(initial=0.0) for w in W]))
        self.newton_steps, self.reduction, self.goal = 0, REDUCTION if self.bodies.springs is None else FINELY, 0.0
        self.ends: dict[str, int] = {}
        self.left: dict[int, float] = {}

    def solve(self, step: int, number: int, F0: np.ndarray, resultant: np.ndarray, before: History,
              radius: float | np.ndarray, anchor: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, n) y of one load step, and (3, P) F = F₀ + L y.

        step : of those solved together: what it needed is remembered for the next iteration; number : in the scene
        F0 : (3, P) predicted forces
        resultant : (bodies, n) Uᵀf
        before : what the load step before has left
        radius : longest move of a body in one Newton step; (bodies,) or of all
        anchor : (3, P) jump at which springs carry nothing; None: the one before
        """
        at = LoadStep(self.bodies, number, F0, resultant, before, anchor)
        y, size, start, end = self._newton(at, radius)
        self.ends[end] = self.ends.get(end, 0) + 1
        self.left[step] = size / start if start > 0 else 0.0
        return y, at.forces(y)

    def weakened(self, pairs: Pairs) -> CoarseProblem:
        """The same with springs of stabilisation as these pairs have them."""
        other = copy(self)
        other.fields = self.fields.with_springs(pairs)
        other.bodies = self.bodies.stabilised(other.fields)
        return other

    def _newton(self, at: LoadStep, radius: float | np.ndarray) -> tuple[np.ndarray, float, float, str]:
        """Fields (bodies, n), ‖ρ‖ there and at the start, and how it ended."""
        pattern, factors, farthest = self.bodies.pattern, None, np.broadcast_to(radius, self.fields.count)

        def direction(matrix: np.ndarray | bool, rho: np.ndarray, shift: float) -> np.ndarray:
            nonlocal factors
            if pattern is not None:
                factors = pattern.factors(matrix, shift)
            return self._clipped(None if factors is None else -factors.solve(rho), farthest)

        def ahead(rho: np.ndarray) -> np.ndarray:
            return self.team.share(None if factors is None else -factors.solve(rho))

        run, end = Newton(at, np.zeros((self.fields.count, self.fields.size)), direction, ahead, self._farthest), ""
        for number in range(MOST_STEPS + 1):
            if run.solved(self.reduction, self.goal):
                end = "tolerance"
            if end or number == MOST_STEPS:
                break
            self.newton_steps += 1
            end = run.step()
        return run.y, run.size, run.start, end or "steps"

    def _clipped(self, dy: np.ndarray | None, radius: np.ndarray) -> np.ndarray:
        """(bodies, n) rank 0's step. A body that nothing touches has no stiffness to stop it: none moves further than
        its radius (bodies,)."""
        dy = self.team.share(dy)
        move = self.farthest * np.linalg.norm(dy, axis=1)
        if not (move > radius).any():  # as all ranks see
            return dy
        move, most = move[self.own], radius[self.own]
        for e in np.flatnonzero(move > most):  # the others cannot, by Cauchy and Schwarz
            move[e] = np.abs(self.W[e] @ dy[self.own[e]]).max(initial=0.0)
        return dy * np.minimum(1.0, radius / np.maximum(self._of_all(move), np.finfo(float).tiny))[:, None]

    def _farthest(self, y: np.ndarray) -> float:
        """How far any body moves in the fields (bodies, n) at most, by Cauchy and Schwarz."""
        return float((self.farthest * np.linalg.norm(y, axis=1)).max(initial=0.0))

    def state(self) -> dict[str, object]:
        """What a resumed run has to know; factors are formed anew."""
        return {"newton_steps": self.newton_steps, "ends": dict(self.ends)}

    def restore(self, state: Mapping[str, object]) -> None:
        """Take ``state`` back."""
        self.newton_steps, self.ends = state["newton_steps"], dict(state["ends"])

    def _of_all(self, values: np.ndarray) -> np.ndarray:
        return of_all(self.team, self.fields.count, self.own, values)


def of_all(team: Team, bodies: int, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(bodies, …) from what each rank knows of its own bodies."""
    everything = np.zeros((bodies, *values.shape[1:]))
    everything[own] = values
    return team.sum(everything)[0]
