"""The load steps of a run: all together where they do not depend on each other, else increment after increment.

Each increment begins with the state that the one before has ended with, and with its history. Where friction is such that the way to a
load matters, load steps that are solved together may settle where none of them would lead, as where a jammed wedge comes out that stays if
it is let go first: an increment whose bodies are held by springs alone in the end, or fly off, is solved again load step by load step.
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
from orchestrator.method.iterated import Iterated, delivered, event_of
from orchestrator.method.latin import Latin
from orchestrator.method.monitors import Case, monitors_of
from orchestrator.method.monitors.ending import DIVERGED, HELD
from orchestrator.method.stopping.law_residuals import LengthScale
from orchestrator.timing import Stopwatch

TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4
# What a load step of nonlinear matter begins with is elastic to this residual, or after so many iterations as good as it will be.
FORESEEN, MOST_FORESEEN = 1e-2, 100


def iterate(d: Decomposition, method, subscribers: Sequence[Subscriber], watch: Stopwatch, start: Start = Start(),
            numbers: Sequence[int] | None = None, given: Mapping[str, Any] | None = None) -> Iterated:
    """Solve all load steps; with perfect interfaces they are one increment.

    method : ``method`` of the configuration. ``increment`` load steps are solved together. One that does not converge does not
        keep the next ones from being tried: of the iterations that are allowed for all of them, one is left to each
    subscribers : told of every ``Iteration``, and that they have ``Finished``
    start : where to go on from
    numbers : of the load steps, from 1, for people; None: 1, 2, …
    given : for monitors, see ``Case``
    Raises Unbalanced: see ``monitors.placing``
    """
    run = _Run(d, method, watch, range(1, d.steps + 1) if numbers is None else numbers, start, given or {})
    told, batches = Subscribers(subscribers), batches_of(d.steps, d.all_perfect, method, bool(d.nonlinear or d.following))
    batches = as_kept(batches, [x.load_steps for x in (*start.ended, *start.latest[-1:])])
    while len(run.ended) < len(batches):
        if not run.solve(len(run.ended), batches, told):
            batches = one_by_one(batches, len(run.ended))
    result = Iterated.joined(run.ended)
    told.finished(Finished(result.converged, result.stop_reason, result.iterations))
    return result


class _Run:
    """Increments that are solved so far; ``d`` has the pairs of the last one.

    as for ``iterate``
    """

    def __init__(self, d: Decomposition, method, watch: Stopwatch, numbers: Sequence[int], start: Start, given: Mapping[str, Any]):
        self.d, self.method, self.watch, self.numbers, self.start, self.given = d, method, watch, numbers, start, given
        self.state = np.zeros((d.steps, d.space.size)) if start.state is None else start.state.copy()
        self.ended: list[Iterated] = []
        self.begun = start.before  # iterations of earlier runs
        self.lost: list[Iterated] = []  # increments that are solved again, step by step

    def solve(self, number: int, batches: Sequence[slice], told: Subscriber) -> bool:
        """One increment of load steps; False: its load steps are to be solved one by one."""
        start, steps, left = self.start, batches[number], len(batches) - 1 - number
        view, first = self._view(number, steps, len(batches) > 1), self.state[steps].copy()
        # a load step may unload: what its residuals are relative to is what the scene was told in all of them
        told_all = LengthScale(self.d).told if len(batches) > 1 and not self.d.all_perfect else 0.0
        latin = Latin(view, self.method, monitors_of(Case(view, self.method, self.numbers[steps], told_all, self.given)), self.watch)
        if number < len(start.ended):
            result = ended(latin, start.ended[number])
        else:
            if self.ended and start.state is None:
                self.state[steps] = self.ended[-1].fields.s[-1:]
            if number == len(start.ended) and start.latest and not self.lost:
                go_on(latin, start.latest)
            else:
                self._begin(latin, number, steps)
            if self.begun is None:
                self.begun = latin.number
            # one is left to each that follows, and one to this: it gives the fields
            latin.last = max(self.begun + self.method.max_iterations - left, latin.number + 1)
            result = self._iterated(latin, number, steps, left, told)
        if path_matters(latin.problem, result.stop_reason):
            self.state[steps], self.lost = first, [*self.lost, result]
            return False
        self.state[steps] = result.fields.s
        self.ended.append(result)
        if self.d.following is not None:
            self.d = self.d.paired_as(latin.problem)
        return True

    def _view(self, number: int, steps: slice, several: bool) -> Decomposition:
        """The decomposition for the load steps of an increment, and what the one before has left."""
        d, before = self.d, self.ended[-1] if self.ended else None
        history = None if before is None else before.local.left()
        if d.following is not None and before is not None:
            history = d.following.begin(d.local.pairs, before.fields, before.local)
        if d.nonlinear is not None:
            d = d.foreseen(number)
        return d.batch(steps, history, before and before.bound) if several or d.nonlinear is not None else d

    def _begin(self, latin: Latin, number: int, steps: slice) -> None:
        """From the state, after so many iterations and sweeps as have been done."""
        start, before = self.start, [*self.ended[-1:], *self.lost[-1:]]
        latin.number = max([start.iteration, *(x.iterations for x in before)])
        latin.sweeps = max([start.sweeps, *(x.sweeps for x in before)])
        if self.ended and number == len(start.ended) and latin.problem.coarse is not None:
            latin.problem.coarse.problem.restore(start.ended[-1].state_of("coarse"))
        if latin.problem.nonlinear is not None:
            self.state[steps] = foreseen(latin.problem, self.method, self.state[steps], self.numbers[steps], self.watch)
        latin.s = self.state[steps].copy()  # those who listen write into what they were given

    def _iterated(self, latin: Latin, number: int, steps: slice, left: int, told: Subscriber) -> Iterated:
        """Iterate to the end: eq. 6 is solved."""
        history = [event for x in self.lost for event in x.history if event.iteration > (self.ended[-1].iterations if self.ended else 0)]
        while True:
            now = latin.iterate()
            for sentence in now.verdict.warnings:
                told.warned(sentence)
            event = event_of(now, latin.sweeps, self.start.seconds + self.watch.total)
            history.append(event.without_state())
            state, kept = event.state, Checkpoint.of(latin, now, event, number, not left, self.d.steps)
            if latin.problem is not self.d:
                self.state[steps], state = state, self.state
            again = path_matters(now.problem, now.verdict.reason)  # nobody goes on from there
            told.iteration(replace(event, state=state, checkpoint=None if again else kept))
            if now.verdict.reason:
                break
        with self.watch("linear_stage"):
            best = now.problem.stage.ended(now.best)
        with self.watch("bound"):
            known = now.verdict.bound if best is now.best else None
            return delivered(latin, (best, now.local, event), (bool(now.verdict.met), now.verdict.reason), history, known)


def foreseen(view: Decomposition, method, s: np.ndarray, numbers: Sequence[int], watch: Stopwatch) -> np.ndarray:
    """State (1, D) to begin a load step with where matter is nonlinear: the elastic answer to what the step adds, roughly.

    Nobody is asked what matter truly does, and nobody is told. Without it, parts would be asked under forces that nothing bears,
    as where a body is to slide and has not been let go yet.
    """
    elastic = replace(view, stage=view.stage.under(view.loading), following=None)
    rough = method.model_copy(update={"tolerance": method.tolerance.model_copy(update={"error": FORESEEN})})
    latin = Latin(elastic, rough, monitors_of(Case(elastic, rough, numbers)), watch)
    latin.s, latin.last = s.copy(), MOST_FORESEEN
    while True:
        now = latin.iterate()
        if now.verdict.reason:
            return now.best.s


def batches_of(steps: int, perfect: bool, method, one_by_one: bool = False) -> list[slice]:
    """The load steps that are solved together; parameters as for ``check_iterations``."""
    if perfect and not one_by_one:
        return [slice(0, steps)]
    size = 1 if one_by_one else method.increment
    if size == "auto":
        size = steps if steps <= TOGETHER else INCREMENT
    return [slice(a, min(a + size, steps)) for a in range(0, steps, size)]


def one_by_one(batches: Sequence[slice], number: int) -> list[slice]:
    """The same with the load steps of one batch each by itself."""
    part = batches[number]
    return [*batches[:number], *(slice(t, t + 1) for t in range(part.start, part.stop)), *batches[number + 1:]]


def as_kept(batches: Sequence[slice], counts: Sequence[int]) -> list[slice]:
    """Those of a run that is gone on with, whose first ones had so many load steps."""
    for number, count in enumerate(counts):
        if batches[number].stop - batches[number].start > count:
            batches = one_by_one(batches, number)
    return list(batches)


def path_matters(problem: Decomposition, reason: str) -> bool:
    """Whether load steps are to be solved again one by one, as they have ended for this reason; all ranks ask."""
    return reason in (HELD, DIVERGED) and problem.path_dependent


def check_iterations(steps: int, perfect: bool, method, one_by_one: bool = False) -> None:
    """Every increment of load steps needs an iteration for its fields.

    one_by_one : whether load steps follow each other because matter is nonlinear, or sides are paired anew as they slide
    Raises Refusal: that is more than ``method.max_iterations``
    """
    count = len(batches_of(steps, perfect, method, one_by_one))
    if count > method.max_iterations:
        raise Refusal("too few iterations", allowed=method.max_iterations, count=count)
