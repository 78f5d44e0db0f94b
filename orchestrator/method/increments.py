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
from orchestrator.method.halving import Increment, increments_of, may_be_halved, part_of, path_sentence, proportional
from orchestrator.method.iterated import Iterated, delivered, event_of
from orchestrator.method.interface.pairs import History
from orchestrator.method.latin import Latin
from orchestrator.method.monitors import Case, Evaluation, monitors_of
from orchestrator.method.monitors.ending import HELD
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch

# An increment does not settle whose law residual has not fallen to such a share of its least in so
# many iterations.
FALLS, PATIENCE = 0.5, 100
UNSETTLED = "law residual stands still"
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
    while len(run.ended) < len(run.increments):
        run.solve(told)
    result = Iterated.joined(run.ended)
    if run.path:
        result = replace(result, found={**result.found, "path": run.path})
    told.finished(Finished(result.converged, result.stop_reason, result.iterations))
    return result


class _Run:
    """Increments that are solved so far; ``d`` has the pairs of the last one.

    as for ``iterate``

    increments : all, those that are to be solved as well
    path : of those that were solved again in smaller steps, or could not be: load steps, from 1,
        part, why and after which iteration
    lost : events of the increment under way that belong to larger steps
    done : iterations, and sweeps
    least : law residual of the increment under way, and the iteration from which it has fallen no
        more
    """

    def __init__(self, d: Decomposition, method, watch: Stopwatch, numbers: Sequence[int],
                 start: Start, given: dict[str, Any]):
        self.d, self.method, self.watch, self.numbers, self.start, self.given = d, method, watch, numbers, start, given
        self.state = np.zeros(
            (d.steps, d.space.size)) if start.state is None else start.state.copy()
        self.increments = increments_of(d.steps, d.scene, method)
        known = [*start.ended, *start.latest[-1:]]
        for number, kept in enumerate(known):
            self._split_as(number, kept)
        self.path: list[dict[str, Any]] = list(known[-1].notes["path"]) if known else []
        self.has_history, self.halves, self.proportional = d.has_history, may_be_halved(
            d, method), proportional(d)
        self.ended: list[Iterated] = []
        self.left: History | None = None  # what the last of these has left
        self.begun: int | None = None  # iterations of earlier runs
        self.lost: list[Any] = []
        self.done = start.iteration, start.sweeps
        self.least = np.inf, 0

    def solve(self, told: Subscriber) -> None:
        """One increment, or that it is to be solved in smaller steps."""
        number, start = len(self.ended), self.start
        increment = self.increments[number]
        steps, several = increment.steps, len(self.increments) > 1
        view, first = self._view(number, increment, several), self.state[steps].copy()
        case = Case(view, self.method, self.numbers[steps], self.d, self.ended, self.given)
        latin = Latin(view, self.method, monitors_of(case), self.watch)
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
            latin.last = max(self.begun + self.method.max_iterations - self._left(number),
                             latin.number + 1)
            result = self._iterated(latin, number, told)
        self.done = max(self.done[0], latin.number), max(self.done[1], latin.sweeps)
        if result is None:
            self.state[steps] = first
            return
        self.state[steps] = result.fields.s
        self.ended.append(replace(result, part=increment.end < 1))
        self.lost = []
        self._pass(number, result.converged, result.stop_reason)
        if self._left(number):
            self.left = result.left()
            for monitor in latin.monitors:
                self.d, self.left = monitor.passed(self.d, result, self.left)

    def _left(self, number: int) -> int:
        """Number of increments that follow."""
        return len(self.increments) - 1 - number

    def _smaller(self, number: int, now: Evaluation) -> str:
        """Why an increment is to be solved again in smaller steps; empty: it is not."""
        parts = self._parts(number)
        if not parts or now.number + len(parts) + self._left(
            number) > self.begun + self.method.max_iterations:
            return ""
        reason, residual = now.verdict.reason, now.verdict.laws.largest_other
        if residual <= FALLS * self.least[0]:
            self.least = residual, now.number
        if not reason and now.number >= self.least[1] + PATIENCE:
            return UNSETTLED
        # in smaller parts springs would carry less, but a number for them is what it is
        asked = reason == HELD and len(
            self.increments[number]) == 1 and self.method.contact.stabilisation != "auto"
        return reason if now.verdict.led and not asked else ""

    def _parts(self, number: int) -> list[Increment]:
        """Parts in which an increment would be solved again; nothing where the way to a load does
        not count.
        """
        increment = self.increments[number]
        if not self.has_history:
            return []
        if len(increment) > 1:
            return increment.one_by_one
        stuck = increment.begin > 0 and not self.ended[-1].converged
        vain = self.proportional and increment.steps.start == 0 and increment.begin == 0
        return increment.halves if self.halves and not (stuck or vain) else []

    def _part(self, number: int, why: str, after: int, told: Subscriber) -> None:
        """Solve an increment again in smaller steps."""
        self.path.append(self._entry(number, why, after))
        if len(self.increments[number]) == 1:
            told.warned(path_sentence(self.path[-1]))
        self.increments[number:number + 1] = self._parts(number)

    def _pass(self, number: int, converged: bool, reason: str) -> None:
        """Once an increment has ended: of a load step a part of which does not converge, all that
        is left is tried as a whole.
        """
        increment = self.increments[number]
        if converged or increment.end == 1:
            return
        rest = [x for x in self.increments[number + 1:] if x.steps != increment.steps]
        self.increments[number + 1:] = [Increment(increment.steps, increment.end), *rest]
        if number >= len(self.start.ended):
            self.path.append(self._entry(number, reason, self.done[0], stuck=True))

    def _entry(self, number: int, why: str, after: int, stuck: bool = False) -> dict[str, Any]:
        """Entry on an increment that is solved again in smaller steps, or is ``stuck``."""
        increment, numbers = self.increments[number], self.numbers[self.increments[number].steps]
        return {"load_steps": [int(numbers[0]), int(numbers[-1])],
                "part": [increment.begin, increment.end], "why": why, "after": after,
                "stuck": stuck}

    def _split_as(self, number: int, kept: Checkpoint) -> None:
        """The increments of a run that is gone on with."""
        if kept.load_steps < len(self.increments[number]):
            self.increments[number:number + 1] = self.increments[number].one_by_one
        while self.increments[number].end > kept.notes["part"][1]:
            self.increments[number:number + 1] = self.increments[number].halves
        if kept.ended:
            self._pass(number, kept.notes["met"], kept.notes["reason"])

    def _view(self, number: int, increment: Increment, several: bool) -> Decomposition:
        """The decomposition for the load steps of an increment, and what the one before has
        left.
        """
        d, before = self.d, self.ended[-1] if self.ended else None
        if d.nonlinear is not None:
            d = d.foreseen(number)
        if increment.begin > 0 or increment.end < 1:
            return part_of(d, increment, self.left, before and before.bound)
        return d.batch(increment.steps, self.left, before
                       and before.bound) if several or d.nonlinear is not None else d

    def _begin(self, latin: Latin, number: int, steps: slice) -> None:
        """Begin from the state, after so many iterations and sweeps as have been done."""
        start = self.start
        latin.number, latin.sweeps = self.done
        if self.ended and number == len(start.ended) and latin.problem.coarse is not None:
            latin.problem.coarse.problem.restore(start.ended[-1].state_of("coarse"))
        if latin.problem.nonlinear is not None:
            self.state[steps] = foreseen(latin.problem, self.method, self.state[steps],
                                         self.numbers[steps], self.watch)
        latin.s = self.state[steps].copy()  # those who listen write into what they were given

    def _iterated(self, latin: Latin, number: int, told: Subscriber) -> Iterated | None:
        """Iterate to the end: eq. 6 is solved. None: it is to be solved in smaller steps."""
        increment, left, history = self.increments[number], self._left(number), self.lost
        told_of = {"steps": self.d.steps, "part": [increment.begin, increment.end],
                   "path": list(self.path)}
        self.least = np.inf, latin.number
        while True:
            now = latin.iterate()
            for sentence in now.verdict.warnings:
                told.warned(sentence)
            event = event_of(now, latin.sweeps, self.start.seconds + self.watch.total)
            history.append(event.without_state())
            state, smaller = event.state, self._smaller(number, now)
            # nobody goes on from there
            kept = None if smaller else Checkpoint.of(latin, now, event, number, not left, told_of)
            if latin.problem is not self.d:
                self.state[increment.steps], state = state, self.state
            told.iteration(replace(event, state=state, checkpoint=kept))
            if smaller:
                self._part(number, smaller, now.number, told)
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
