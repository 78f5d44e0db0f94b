"""The coarse contact problem: n = 12 fields per body, or 6, the true laws at every node pair, load
step by load step.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y) = 0

``newton`` solves it. Where contacts are stabilised every body has a place, however far, and it
finds that. No step is cut there: bodies that lean on each other, as the stones of an arch, find no
place where each is held back by itself. Elsewhere a body that hardly anything holds moves no
further than the radius in a step: such bodies come to rest over several iterations of the method.

Springs that begin anew hold a body where it is, whatever pushes it. ``rest`` solves the problem
with stiff ones, begins anew with weaker ones where bodies have come to rest, and so on: proximal
points yⱼ₊₁ of the true laws,

    ρ(y) − Σ_pairs Tᵀ εⱼ (F₀ + L y − keq d(yⱼ) − law(F₀ + L y)) = 0,     ε₀ > ε₁ > …

(Rockafellar, SIAM J. Control Optim. 14, 1976), which converge the faster the weaker springs become.

Among ranks, what belongs to a body is formed by its rank, and interfaces are dealt out
(``load_step.dealt``). Newton's matrices are summed over the ranks, and rank 0 eliminates them.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np

from orchestrator.config.method import STABLEST
from orchestrator.method.coarse.load_step import Bodies, LoadStep
from orchestrator.method.coarse.newton import Newton
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.parallel.team import Team

REDUCTION = 1e-2  # it need not be solved better than the iteration it serves
MOST_STEPS = 60  # every body has a place, where contacts are stabilised, and it pays to find it
# ε with which bodies come to rest in turn, over that of the weakest springs
RUNGS = 10.0 ** np.arange(2, -1, -1)


class CoarseProblem:
    """The coarse contact problem, for any load step.

    team : the ranks
    own : (b,) int, the bodies of this rank
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, n, n) stiffness of the fields
    W : per own body (t, n), displacement of its traces in the fields
    rigid : how many fields, the first, a body moves in far more easily than in the others; none
        where that is not known
    bodies : what all load steps have in common, with the weakest springs
    reduction, goal : of ‖ρ‖ at the start, and in its own unit, to which a load step is solved
    most : Newton steps that a solve may take
    newton_steps : Newton steps of all bodies taken so far
    ends : how solves have ended so far → how many: "tolerance", or why not there: "steps" (as many
        as are allowed), "no direction" (whatever the shift)
    left : per load step, ‖ρ‖ that its last solve left, over that at its start
    """

    def __init__(self, team: Team, own: np.ndarray, fields: PairFields, K0: np.ndarray,
                 W: list[np.ndarray], rigid: int = 0):
        self.team, self.own, self.fields, self.W = team, np.asarray(own, dtype=int), fields, W
        self.bodies = Bodies.of(team, self.own, fields, K0, rigid)
        self._sprung: dict[int, Bodies] = {}
        self.farthest = self._of_all(
            np.array([np.linalg.norm(w, axis=1).max(initial=0.0) for w in W]))
        self.newton_steps, self.reduction, self.goal, self.most = 0, REDUCTION, 0.0, MOST_STEPS
        self.ends: dict[str, int] = {}
        self.left: dict[int, float] = {}

    def solve(self, step: int, number: int, F0: np.ndarray, resultant: np.ndarray, before: History,
              radius: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, n) y of one load step, and (3, P) F = F₀ + L y.

        step : of those solved together: what it needed is remembered for the next iteration; number
            : in the scene
        F0 : (3, P) predicted forces
        resultant : (bodies, n) Uᵀf
        before : what the load step before has left
        radius : (bodies,) longest move of each in one Newton step; None: any
        """
        at = LoadStep(self.bodies, number, F0, resultant, before)
        run, end = self._newton(at, np.zeros((self.fields.count, self.fields.size)), self.goal,
                                self.most, radius)
        self.ended(step, end, run.size, run.start)
        return run.y, at.forces(run.y)

    def rest(self, step: int, number: int, F0: np.ndarray, resultant: np.ndarray, before: History,
             anchor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same where springs begin anew, and the y (bodies, n) where they carried nothing in
        the end.

        anchor : (3, P) jumps at which they carry nothing to begin with
        """
        y = yj = np.zeros((self.fields.count, self.fields.size))
        start, size, goal = 0.0, 0.0, self.goal
        for rung in range(len(RUNGS)):
            bodies = self._with_springs(rung)
            at = LoadStep(bodies, number, F0, resultant, before, anchor)
            run, end = self._newton(at, y, goal, self.most)
            if rung and end != "tolerance":  # bodies are at rest with the springs before
                break
            if not rung:
                start, goal = run.start, max(goal, self.reduction * run.start)
            y, yj, size = run.y, y, run.size
            if end != "tolerance":
                break
            F, pairs = at.forces(y), bodies.fields.pairs
            anchor = pairs.settled(pairs.force(F, before, number).force, F, anchor)[1]
        self.ended(step, end, size, start)
        return y, yj

    def ended(self, step: int, end: str, size: float, start: float) -> None:
        self.ends[end] = self.ends.get(end, 0) + 1
        self.left[step] = size / start if start > 0 else 0.0

    def _with_springs(self, rung: int) -> Bodies:
        """``bodies`` with springs that are as much stiffer as ``RUNGS`` says."""
        if rung == len(RUNGS) - 1:
            return self.bodies
        if rung not in self._sprung:
            pairs = self.fields.pairs
            stiff = replace(pairs,
                            stabilisation=np.minimum(RUNGS[rung] * pairs.stabilisation, STABLEST))
            self._sprung[rung] = self.bodies.stabilised(self.fields.with_springs(stiff))
        return self._sprung[rung]

    def weakened(self, pairs: Pairs) -> CoarseProblem:
        """The same with springs of stabilisation as these pairs have them."""
        other = copy(self)
        other.fields = self.fields.with_springs(pairs)
        other.bodies = self.bodies.stabilised(other.fields)
        other._sprung = {}
        return other

    def _newton(self, at: LoadStep, y: np.ndarray, goal: float, most: int,
                radius: np.ndarray | None = None) -> tuple[Newton, str]:
        """The iterates from fields y (bodies, n) on, to a goal of ‖ρ‖ if to nothing else, and how
        they ended.
        """
        run, end = Newton(at, y, self._farthest, None if radius is None
                          else partial(self._clipped, radius)), ""
        for number in range(most + 1):
            if run.solved(self.reduction, goal):
                end = "tolerance"
            if end or number == most:
                break
            self.newton_steps += 1
            end = "" if run.step() else "no direction"
        return run, end or "steps"

    def _clipped(self, radius: np.ndarray, dy: np.ndarray) -> np.ndarray:
        """(bodies, n) the step. A body that nothing touches has no stiffness to stop it: none moves
        further than
        its radius (bodies,)."""
        move = self.farthest * np.linalg.norm(dy, axis=1)
        if not (move > radius).any():  # as all ranks see
            return dy
        move, most = move[self.own], radius[self.own]
        for e in np.flatnonzero(move > most):  # the others cannot, by Cauchy and Schwarz
            move[e] = np.abs(self.W[e] @ dy[self.own[e]]).max(initial=0.0)
        move = self._of_all(move)
        return dy * np.divide(radius, move, out=np.ones_like(move), where=move > radius)[:, None]

    def _farthest(self, y: np.ndarray) -> float:
        """How far any body moves in the fields (bodies, n) at most, by Cauchy and Schwarz."""
        return float((self.farthest * np.linalg.norm(y, axis=1)).max(initial=0.0))

    def state(self) -> dict[str, object]:
        """Return what a resumed run has to know; factors are formed anew."""
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
