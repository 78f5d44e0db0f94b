"""The iterations of the multiscale LATIN method (Algorithm 1 of the paper, mended).

They tell subscribers what they do, and know nothing of files, of the code behind the black box, or of which
laws the interfaces follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from orchestrator.method.acceleration.choice import make_acceleration
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.iterated import Iterated
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.criteria import Criterion, Verdict, make_criterion
from orchestrator.method.stopping.ending import Ending
from orchestrator.method.stopping.indicator import Measures, measure
from orchestrator.savings import Savings
from orchestrator.timing import Stopwatch

TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4

# (fields, bound) → relative energy error
ErrorOf = Callable[[Admissible, Bound | None], float]
# (decomposition of some load steps, fields, bound) → estimated discretisation error, relative, energy norm
EstimateOf = Callable[[Decomposition, Admissible, Bound], float]


@dataclass(frozen=True)
class Start:
    """Where iterations begin, if not at the beginning.

    Parameters
    ----------
    state : (T, D) s; None: zero, and in batches of load steps the last state of the batch before
    iteration, sweeps : done so far, set-up not counted
    """

    state: np.ndarray | None = None
    iteration: int = 0
    sweeps: float = 0.0

    @classmethod
    def resumed(cls, d: Decomposition, state: np.ndarray, iteration: int, sweeps: float) -> Start:
        """Where an earlier run stood, as its last event told: the state of all ranks, sweeps with its set-up."""
        return cls(state[:, d.space.number], iteration, sweeps - d.setup_sweeps)


def iterate(d: Decomposition, method, subscribers: Sequence[Subscriber], watch: Stopwatch, start: Start = Start(), *,
            true_error: ErrorOf | None = None, estimate: EstimateOf | None = None,
            savings: Savings | None = None) -> Iterated:
    """Solve all load steps, batch after batch; with perfect interfaces there is one batch.

    Parameters
    ----------
    method : ``method`` of the configuration: acceleration, relaxation, tolerance, max_iterations. ``increment``
        load steps make a batch. Each starts from the state that the one before ended with, and from its jumps:
        the history of friction goes on. A batch that does not converge does not keep the next ones from being tried
    subscribers : told of every ``Iteration``, and that they have ``Finished``
    true_error : of what would be delivered, where the exact solution is known; it is called after every stage
    estimate : of the discretisation error; needed for ``tolerance: {error: auto}``
    savings : where it is noted what need not be done
    """
    told, batches = Subscribers(subscribers), _batches(d, method.increment)
    state = np.zeros((d.steps, d.space.size)) if start.state is None else start.state.copy()
    ended: list[Iterated] = []
    for steps in batches:
        view, listener = d, told
        if len(batches) > 1:
            view = d.batch(steps, ended[-1].local.jump[-1] if ended else None)
            listener = _PartOfAll(told, state, steps)
        if ended and start.state is None:
            state[steps] = ended[-1].fields.s[-1:]
        so_far = (ended[-1].iterations, ended[-1].sweeps) if ended else (start.iteration, start.sweeps)
        ended.append(iterate_batch(view, method, listener, watch, Start(state[steps], *so_far),
                                   true_error=true_error, estimate=estimate))
    result = Iterated.joined(ended)
    if savings is not None and d.space.team.rank == 0:
        savings.add("frozen", "load steps of a linear stage", result.frozen)
        if d.all_perfect:
            savings.add("bound", "evaluations of the bound's second part",
                        sum(math.isnan(event.error_bound) for event in result.history))
    told.finished(Finished(result.converged, result.stop_reason, result.iterations))
    return result


def iterate_batch(d: Decomposition, method, told: Subscriber, watch: Stopwatch, start: Start, *,
                  true_error: ErrorOf | None = None, estimate: EstimateOf | None = None) -> Iterated:
    """Alternate linear and local stages until the stopping criterion holds for all steps of a batch: eq. 6 is solved.

    Parameters as for ``iterate``; ``start`` has a state.
    """
    acceleration = make_acceleration(d, method)
    criterion = make_criterion(d, method.tolerance, estimate and partial(estimate, d), method.skip.bound)
    ending, exact = Ending(start.iteration + method.max_iterations), method.tolerance.indicator is not None
    share = d.steps / d.scene.steps  # of a sweep through all load steps
    s, iteration, sweeps, reason = start.state, start.iteration, start.sweeps, None
    frozen, left_out, history = np.zeros(d.steps, dtype=bool), 0, []
    while reason is None:
        iteration += 1
        with watch("linear_stage"):
            evaluated = d.stage(s)
            moved, asked = d.space.team.max(np.abs(evaluated.w).max(initial=0.0), s.any())
            sweeps += asked * share * (1 - frozen.mean())
        if d.coarse is not None:
            with watch("coarse"):
                evaluated = d.coarse(evaluated)
        with watch("local_stage"):
            local = d.local(evaluated)
        with watch("acceleration"):
            residual, best = acceleration.take(evaluated, local.s)
        with watch("bound"):
            measures = measure(d.stage, d.local, best, local, residual, exact)
            verdict = criterion(best, local, measures)
            sweeps += verdict.sweeps * share
            event = _event(criterion, verdict, measures(), iteration=iteration, sweeps=d.setup_sweeps + sweeps,
                           seconds=watch.total, state=best.s)
        if true_error is not None:
            event = replace(event, true_error=true_error(best, verdict.bound))
        history.append(replace(event, state=event.state[:0]))  # the states themselves are large
        told.iteration(event)
        reason = ending.reason(iteration, verdict.met, event.residual, moved)
        if reason is None:
            with watch("acceleration"):
                s = acceleration.next()
                if method.skip.frozen:
                    frozen = criterion.done
                    left_out += _freeze(s, evaluated.s, frozen)
    with watch("bound"):
        bound, spent = criterion.final(best, verdict.bound)
        sweeps += spent * share
    return Iterated(best, local, bound, verdict.met, reason, iteration, sweeps, event, history, left_out)


def _event(criterion: Criterion, verdict: Verdict, measures: Measures, **progress) -> Iteration:
    """What is told of an iteration."""
    laws = {} if verdict.laws is None else {"law_residual": verdict.laws.largest, "laws": verdict.laws.measures}
    return Iteration(
        **progress, indicator=measures.indicator, displacement_jump=measures.displacement_jump,
        force_imbalance=measures.force_imbalance, residual=measures.residual, macro_imbalance=measures.macro_imbalance,
        counts=measures.counts, target=(criterion.name, criterion.value),
        error_bound=verdict.error_bound, discretisation_error=verdict.discretisation_error, **laws)


def _freeze(s: np.ndarray, asked: np.ndarray, done: np.ndarray) -> int:
    """Where load steps are done, s becomes what has been asked for: the answers are remembered. How many they are."""
    s[done] = asked[done]
    return int(done.sum())


def _batches(d: Decomposition, size: int | str) -> list[slice]:
    """The load steps that are solved together."""
    steps = d.steps
    if d.all_perfect:
        return [slice(0, steps)]
    if size == "auto":
        size = steps if steps <= TOGETHER else INCREMENT
    return [slice(a, min(a + size, steps)) for a in range(0, steps, size)]


class _PartOfAll(Subscriber):
    """Hears of the states of a batch and tells of whole ones."""

    def __init__(self, told: Subscriber, state: np.ndarray, steps: slice):
        self.told, self.state, self.steps = told, state, steps

    def iteration(self, event: Iteration) -> None:
        self.state[self.steps] = event.state
        self.told.iteration(replace(event, state=self.state))
