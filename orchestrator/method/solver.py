"""The iterations of the multiscale LATIN method (Algorithm 1 of the paper, mended).

They tell subscribers what they do, and know nothing of files, of the code behind the black box, or of which
laws the interfaces follow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.method.batch import Batch, ErrorOf, EstimateOf
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.iterated import Iterated
from orchestrator.method.placing import Placing
from orchestrator.method.start import Start
from orchestrator.method.stopping.lengths import LengthScale
from orchestrator.savings import Savings
from orchestrator.timing import Stopwatch

TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4
# What a load step of nonlinear matter begins with is elastic to this residual, or after so many iterations as good as it will be.
FORESEEN, MOST_FORESEEN = 1e-2, 100


def iterate(d: Decomposition, method, subscribers: Sequence[Subscriber], watch: Stopwatch, start: Start = Start(), *,
            true_error: ErrorOf | None = None, estimate: EstimateOf | None = None,
            savings: Savings | None = None, numbers: Sequence[int] | None = None,
            placing: Placing | None = None) -> Iterated:
    """Solve all load steps, batch after batch; with perfect interfaces there is one batch.

    Parameters
    ----------
    method : ``method`` of the configuration: acceleration, relaxation, tolerance, max_iterations. ``increment``
        load steps make a batch. Each starts from the state that the one before ended with, and from its jumps:
        the history of friction goes on. A batch that does not converge does not keep the next ones from being tried:
        of the iterations that are allowed for all of them, one is left to each
    subscribers : told of every ``Iteration``, and that they have ``Finished``
    start : where to go on from
    true_error : of what would be delivered, where the exact solution is known; it is called after every stage
    estimate : of the discretisation error; needed for ``tolerance: {error: auto}``
    savings : where it is noted what need not be done
    numbers : of the load steps, from 1, for people; None: 1, 2, …
    placing : of several ranks, judges whether they are balanced

    Raises
    ------
    Unbalanced : they are not, see there
    """
    numbers = range(1, d.steps + 1) if numbers is None else numbers
    told, batches = Subscribers(subscribers), batches_of(d.steps, d.all_perfect, 1 if d.nonlinear or d.following else method.increment)
    state = np.zeros((d.steps, d.space.size)) if start.state is None else start.state.copy()
    ended: list[Iterated] = []
    # a load step may unload: what its residuals are relative to is what the scene was told in all of them
    told_of_all = LengthScale(d).told if len(batches) > 1 and not d.all_perfect else 0.0
    begun: int | None = None  # iterations of earlier runs
    for number, steps in enumerate(batches):
        before = ended[-1].local.left() if ended else None
        if d.following is not None and ended:
            before = d.following.begin(batch.d.local.pairs, ended[-1].fields, ended[-1].local)
            d = d.paired_as(batch.d)
        if d.nonlinear is not None:
            d = d.foreseen(number)
        view, listener = d, told
        if len(batches) > 1 or d.nonlinear is not None:
            view = d.batch(steps, before)
            listener = _PartOfAll(told, state, steps)
        batch = Batch(view, method, (number, len(batches), d.steps), numbers[steps], watch, true_error, estimate, placing)
        if told_of_all:
            batch.criterion.lengths.told = max(batch.criterion.lengths.told, told_of_all)
        if number < len(start.ended):
            ended.append(batch.recalled(start.ended[number]))
            state[steps] = ended[-1].fields.s
            continue
        if ended and start.state is None:
            state[steps] = ended[-1].fields.s[-1:]
        if number == len(start.ended) and start.latest:
            batch.recall(start.latest)
        else:
            done = max([start.iteration, *(b.iterations for b in ended[-1:])]), max([start.sweeps, *(b.sweeps for b in ended[-1:])])
            if ended and number == len(start.ended) and d.coarse is not None:
                batch.d.coarse.problem.recall(start.ended[-1])
            if d.nonlinear is not None:
                state[steps] = _foreseen(view, method, state[steps], numbers[steps], watch)
            batch.begin(state[steps], *done)
        if begun is None:
            begun = batch.iteration if start.before is None else start.before
        batch.end_at(begun + method.max_iterations - (len(batches) - 1 - number))  # one is left to each that follows
        ended.append(batch.iterate(listener, start.seconds))
    result = Iterated.joined(ended)
    if savings is not None and d.space.team.rank == 0:
        savings.add("frozen", "load steps of a linear stage", result.frozen)
        if d.all_perfect:
            savings.add("bound", "evaluations of the bound's second part",
                        sum(math.isnan(event.error_bound) for event in result.history))
    told.finished(Finished(result.converged, result.stop_reason, result.iterations))
    return result


def _foreseen(view: Decomposition, method, s: np.ndarray, numbers: Sequence[int], watch: Stopwatch) -> np.ndarray:
    """State (1, D) to begin a load step with where matter is nonlinear: the elastic answer to what the step adds, roughly.

    Nobody is asked what matter truly does, and nobody is told. Without it, parts would be asked under forces that nothing bears,
    as where a body is to slide and has not been let go yet.
    """
    elastic = replace(view, stage=view.stage.under(view.loading.boundary, view.loading.known), following=None)
    rough = method.model_copy(update={"tolerance": method.tolerance.model_copy(update={"error": FORESEEN})})
    batch = Batch(elastic, rough, (0, 1, 1), numbers, watch, None, None)
    batch.begin(s, 0, 0.0)
    batch.end_at(MOST_FORESEEN)
    return batch.iterate(Subscriber()).fields.s


def batches_of(steps: int, perfect: bool, size: int | str) -> list[slice]:
    """The load steps that are solved together.

    Parameters
    ----------
    steps : number of load steps
    perfect : whether all interfaces are
    size : ``method.increment``
    """
    if perfect:
        return [slice(0, steps)]
    if size == "auto":
        size = steps if steps <= TOGETHER else INCREMENT
    return [slice(a, min(a + size, steps)) for a in range(0, steps, size)]


def check_iterations(steps: int, perfect: bool, method, one_by_one: bool = False) -> None:
    """Every batch of load steps needs an iteration for its fields.

    Parameters
    ----------
    one_by_one : whether load steps follow each other because matter is nonlinear, or sides are paired anew as they slide

    Raises
    ------
    InputError : that is more than ``method.max_iterations``
    """
    count = len(batches_of(steps, perfect and not one_by_one, 1 if one_by_one else method.increment))
    if count > method.max_iterations:
        raise InputError(Problem(
            ("method", "max_iterations"), f"{method.max_iterations} iterations for {count} batches of load steps",
            f"at least {count}: it bounds the whole run, and every batch takes one", "raise it, or raise method.increment"))


class _PartOfAll(Subscriber):
    """Hears of the states of a batch and tells of whole ones."""

    def __init__(self, told: Subscriber, state: np.ndarray, steps: slice):
        self.told, self.state, self.steps = told, state, steps

    def iteration(self, event: Iteration) -> None:
        self.state[self.steps] = event.state
        self.told.iteration(replace(event, state=self.state))

    def warned(self, sentence: str) -> None:
        self.told.warned(sentence)
