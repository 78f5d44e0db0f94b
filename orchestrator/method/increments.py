"""The load steps of a run: all together where they do not depend on each other, else increment
after increment.

Each increment begins with the state that the one before has ended with, and with its history. Where
the way to a load counts, load steps that are solved together may settle where none of them would
lead, as where a jammed wedge comes out that stays if it is let go first. Such an increment is
solved again in smaller steps where its bodies are held by springs alone in the end, or fly off, or
its law residual has stopped to fall: load step by load step, and a single one in two halves, each
of which may be halved again (``halving``). What comes after is tried as a whole again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.errors import Refusal
from orchestrator.method.checkpoint import Checkpoint, Start, ended, go_on
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Finished, Subscriber, Subscribers
from orchestrator.method.halving import increments_of, part_of, Plan
from orchestrator.method.iterated import Iterated, delivered, event_of
from orchestrator.method.latin import Latin
from orchestrator.method.monitors import Case, monitors_of
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch

# What a load step of nonlinear matter begins with is elastic to this residual, or after so many
# iterations as good as it will be.
FORESEEN, MOST_FORESEEN = 1e-2, 100


def iterate(d: Decomposition, method, subscribers: Sequence[Subscriber], watch: Stopwatch,
            start: Start = Start(),
            numbers: Sequence[int] | None = None, given: Mapping[str, Any]
            | None = None) -> Iterated:
    """Solve all load steps; with perfect interfaces they are one increment.

    method : ``method`` of the configuration. ``increment`` load steps are solved together. One that
        does not converge does not keep the next ones from being tried: of the iterations that are
        allowed for all of them, one is left to each
    subscribers : told of every ``Iteration``, and that they have ``Finished``
    start : where to go on from
    numbers : of the load steps, from 1, for people; None: 1, 2, …
    given : for monitors, see ``Case``
    """
    run = _Run(d, method, watch, range(1, d.steps + 1) if numbers is None else numbers, start,
               dict(given or {}))
    told = Subscribers(subscribers)
    while run.plan.left >= 0:
        run.solve(told)
    result = Iterated.joined(run.ended)
    if run.plan.path:
        result = replace(result, found={**result.found, "path": run.plan.path})
    told.finished(Finished(result.converged, result.stop_reason, result.iterations))
    return result


class _Run:
    """Increments that are solved so far; ``d`` has the pairs of the last one.

    as for ``iterate``

    plan : all, those that are to be solved as well
    ended : results of those that are done; left : what the last of these has left
    lost : events of the increment under way that belong to larger steps
    done : iterations, and sweeps
    begun : iterations of earlier runs
    """

    def __init__(self, d: Decomposition, method, watch: Stopwatch, numbers: Sequence[int],
                 start: Start, given: dict[str, Any]):
        self.d, self.method, self.watch, self.numbers = d, method, watch, numbers
        self.start, self.given, self.plan = start, given | start.near, Plan(d, method, numbers)
        self.plan.resume(start.ended, start.latest)
        self.state = np.zeros(
            (d.steps, d.space.size)) if start.state is None else start.state.copy()
        self.ended: list[Iterated] = []
        self.lost: list[Any] = []
        self.done, self.begun, self.left = (start.iteration, start.sweeps), None, None

    def solve(self, told: Subscriber) -> None:
        """One increment, or that it is to be solved in smaller steps."""
        start, plan = self.start, self.plan
        steps, here = plan.now.steps, plan.at - len(start.ended)
        view, first = self._view(), self.state[steps].copy()
        case = Case(view, self.method, self.numbers[steps], self.d, self.ended, self.given)
        latin = Latin(view, self.method, monitors_of(case), self.watch)
        if here < 0:
            result = ended(latin, start.ended[here])
        else:
            if self.ended and start.state is None:
                self.state[steps] = self.ended[-1].fields.s[-1:]
            if here == 0 and start.latest and not self.lost:
                go_on(latin, start.latest)
            else:
                self._begin(latin, here == 0)
            if self.begun is None:
                self.begun = latin.number
            most = self.begun + self.method.max_iterations
            # one is left to each that follows, and one to this: it gives the fields
            latin.last = max(most - plan.left, latin.number + 1)
            result = self._iterated(latin, most, told)
        self.done = max(self.done[0], latin.number), max(self.done[1], latin.sweeps)
        if result is None:
            self.state[steps] = first
            return
        self.state[steps] = result.fields.s
        self.ended.append(replace(result, part=plan.now.end < 1))
        self.lost = []
        plan.passed(result.converged, result.stop_reason, self.done[0])
        if plan.left >= 0:
            self.left = result.left()
            for monitor in latin.monitors:
                self.d, self.left = monitor.passed(self.d, result, self.left)

    def _view(self) -> Decomposition:
        """The decomposition for the load steps of the increment, and what the one before has
        left.
        """
        d, now, before = self.d, self.plan.now, self.ended and self.ended[-1].bound or None
        if d.nonlinear is not None:
            d = d.foreseen(self.plan.at)
        elif len(self.plan.increments) == 1:
            return d
        if now.begin > 0 or now.end < 1:
            return part_of(d, now, self.left, before)
        return d.batch(now.steps, self.left, before)

    def _begin(self, latin: Latin, first: bool) -> None:
        """Begin from the state, after so many iterations and sweeps as have been done; ``first``:
        of this run.
        """
        steps, coarse = self.plan.now.steps, latin.problem.coarse
        latin.number, latin.sweeps = self.done
        if self.ended and first and coarse is not None:
            coarse.problem.restore(self.start.ended[-1].state_of("coarse"))
        if latin.problem.nonlinear is not None:
            self.state[steps] = foreseen(latin.problem, self.method, self.state[steps],
                                         self.numbers[steps], self.watch)
        if coarse is not None and self.start.origin:  # bodies are near their places
            coarse.begun = True
        latin.s = self.state[steps].copy()  # those who listen write into what they were given

    def _iterated(self, latin: Latin, most: int, told: Subscriber) -> Iterated | None:
        """Iterate to the end: eq. 6 is solved. None: it is to be solved in smaller steps.

        most : iterations that are allowed in all
        """
        plan, history = self.plan, self.lost
        increment, path = plan.now, {"steps": self.d.steps, "part": [plan.now.begin, plan.now.end],
                                     "path": list(plan.path), "origin": self.start.origin}
        plan.least = np.inf, latin.number
        while True:
            now = latin.iterate()
            for sentence in now.verdict.warnings:
                told.warned(sentence)
            event = event_of(now, latin.sweeps, self.start.seconds + self.watch.total)
            history.append(event.without_state())
            state, smaller = event.state, plan.smaller(now, most)
            # nobody goes on from there
            kept = None if smaller else Checkpoint.of(latin, now, event, plan.at, not plan.left,
                                                      path)
            if latin.problem is not self.d:
                self.state[increment.steps], state = state, self.state
            told.iteration(replace(event, state=state, checkpoint=kept))
            if smaller:
                if sentence := plan.split(smaller, now.number):
                    told.warned(sentence)
                return None
            if now.verdict.reason:
                break
            del now, event, state, kept  # the next iteration forms its own
        with self.watch("linear_stage"):
            best = now.problem.stage.ended(now.best)
        with self.watch("bound"):
            known = now.verdict.bound if best is now.best else None
            return delivered(latin, (best, now.local, event),
                             (bool(now.verdict.met), now.verdict.reason), history, known)


def foreseen(view: Decomposition, method, s: np.ndarray, numbers: Sequence[int],
             watch: Stopwatch) -> np.ndarray:
    """State (1, D) to begin a load step with where matter is nonlinear: the elastic answer to what
    the step adds, roughly.

    Nobody is asked what matter truly does, and nobody is told. Without it, parts would be asked
    under forces that nothing bears, as where a body is to slide and has not been let go yet.
    """
    elastic = replace(view, stage=view.stage.under(view.loading))
    rough = method.model_copy(
        update={"tolerance": method.tolerance.model_copy(update={"error": FORESEEN})})
    latin = Latin(elastic, rough, monitors_of(Case(elastic, rough, numbers)), watch)
    latin.s, latin.last = s.copy(), MOST_FORESEEN
    while True:
        now = latin.iterate()
        if now.verdict.reason:
            return now.best.s


def check_iterations(steps: int, scene: Scene, method) -> None:
    """Every increment of load steps needs an iteration for its fields.

    Raises Refusal: that is more than ``method.max_iterations``
    """
    count = len(increments_of(steps, scene, method))
    if count > method.max_iterations:
        raise Refusal("too few iterations", allowed=method.max_iterations, count=count)
