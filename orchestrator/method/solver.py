"""The iterations of the multiscale LATIN method (Algorithm 1 of the paper, mended).

The loop emits events and knows nothing of files, of the code behind the black box, or of which
laws the interfaces follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from orchestrator.method.acceleration.residual_minimisation import Relaxation, ResidualMinimisation
from orchestrator.method.acceleration.anderson import Anderson
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.criteria import make_criterion
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Finished, Iteration
from orchestrator.method.stopping.indicator import measure
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.timing import Stopwatch

STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
RUNAWAY = 1e6  # growth of the displacement that no convergent run shows
CONTACT_MEMORY = 30
TOGETHER = 12  # load steps solved as one batch with contact; more are taken INCREMENT at a time
INCREMENT = 4


@dataclass
class Outcome:
    """What the iterations ended with.

    Parameters
    ----------
    fields : best admissible fields
    local : the last local stage
    bound : their error bound, energy and continuity
    converged, stop_reason : and why
    iterations : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step, iterations alone
    last : the last event
    frozen : load steps that took no part in a linear stage because they were accurate enough, summed over the stages
    """

    fields: Admissible
    local: LocalState
    bound: Bound
    converged: bool
    stop_reason: str
    iterations: int
    sweeps: float
    last: Iteration
    history: list[Iteration] = field(default_factory=list)
    frozen: int = 0


def iterate(d: Decomposition, method, subscribers: Sequence[Callable], watch: Stopwatch,
            start: np.ndarray | None = None, first: int = 0, spent: float = 0.0,
            true_error: Callable | None = None, estimate: Callable | None = None) -> Outcome:
    """Solve all load steps, batch after batch; with perfect interfaces there is one batch.

    Parameters as in ``iterate_batch``. ``method.increment`` load steps make a batch. Each starts from
    the state that the one before ended with, and from its jumps: the history of friction goes on. A
    batch that does not converge does not keep the next ones from being tried.
    """
    steps, size = d.steps, method.increment
    if size == "auto":
        size = steps if d.all_perfect or steps <= TOGETHER else INCREMENT
    batches = [slice(a, min(a + size, steps)) for a in range(0, steps, size)]
    if d.all_perfect:
        batches = [slice(0, steps)]
    whole = np.zeros((d.space.size, steps)) if start is None else start.copy()
    outcomes: list[Outcome] = []
    for batch in batches:
        view = d
        if len(batches) > 1:
            view = d.batch(batch, outcomes[-1].local.jump[-1] if outcomes else None)
        if outcomes and start is None:
            whole[:, batch] = outcomes[-1].fields.s[:, -1:]

        def tell(event: Iteration, batch=batch) -> None:
            if len(batches) > 1:
                whole[:, batch] = event.state
                event = replace(event, state=whole)
            for subscriber in subscribers:
                subscriber(event)

        outcomes.append(iterate_batch(view, method, [tell], watch, whole[:, batch], first, spent, true_error,
                                      estimate))
        first, spent = outcomes[-1].iterations, outcomes[-1].sweeps
    result = outcomes[0] if len(outcomes) == 1 else _joined(outcomes)
    for subscriber in subscribers:
        subscriber(Finished(result.converged, result.stop_reason, result.iterations))
    return result


def _joined(outcomes: list[Outcome]) -> Outcome:
    """The outcome of all batches: columns side by side, the first failure's reason."""
    f, l, b = ([getattr(o, name) for o in outcomes] for name in ("fields", "local", "bound"))
    failed = next((o for o in outcomes if not o.converged), outcomes[-1])
    return Outcome(
        Admissible(*(np.hstack([getattr(x, n) for x in f]) for n in ("s", "u", "alpha", "w", "f"))),
        LocalState(np.hstack([x.s for x in l]), tuple(np.hstack(h) for h in zip(*(x.hats for x in l))),
                   *(np.concatenate([getattr(x, n) for x in l]) for n in ("force", "jump", "status")), l[0].mine),
        Bound(math.nan, math.nan, np.concatenate([x.energy for x in b]), np.hstack([x.repositioned for x in b]),
              np.hstack([x.correction for x in b])),
        all(o.converged for o in outcomes), failed.stop_reason, outcomes[-1].iterations, outcomes[-1].sweeps,
        failed.last, [e for o in outcomes for e in o.history])


def iterate_batch(d: Decomposition, method, subscribers: Sequence[Callable], watch: Stopwatch,
                  start: np.ndarray, first: int = 0, spent: float = 0.0,
                  true_error: Callable | None = None, estimate: Callable | None = None) -> Outcome:
    """Alternate linear and local stages until the stopping criterion holds for all steps of a batch.

    Parameters
    ----------
    method : ``method`` of the configuration: acceleration, relaxation, tolerance, max_iterations
    subscribers : called with every ``Iteration``
    start, first, spent : state (D, T), iteration number and sweeps to start from
    true_error : (fields, bound) → relative energy error, where the exact solution is known
    estimate : (d, fields, bound) → estimated discretisation error; for ``error: auto``
    """
    acceleration, criterion = make_acceleration(d, method), make_criterion(
        d, method.tolerance, lambda fields, bound: estimate(d, fields, bound), method.skip.bound)
    s, sweeps, history, share = start, spent, [], d.steps / d.scene.steps
    last = first + method.max_iterations
    iteration, converged, reason = first, False, "max_iterations"
    reach = 0.0  # largest interface displacement of the first stage
    frozen, left_out = np.zeros(d.steps, dtype=bool), 0  # load steps that need no further stage
    team = d.space.team
    while True:
        iteration += 1
        with watch("linear_stage"):
            evaluated = d.stage(s)
            moved, solved = team.max(np.abs(evaluated.w).max(initial=0.0), s.any())
            sweeps += solved * share * (1 - frozen.mean())
        reach = reach or moved
        if d.coarse is not None:
            with watch("coarse"):
                evaluated = d.coarse(evaluated)
        with watch("local_stage"):
            local = d.local(evaluated.w, evaluated.f)
        with watch("acceleration"):
            residual, best, (u, alpha) = acceleration.best(evaluated.s, local.s, [evaluated.u, evaluated.alpha])
            fields = evaluated if best is evaluated.s else d.stage.complete(best, u, alpha)
        with watch("bound"):
            measures = cache(measure(d.stage, d.local, fields, local, residual,
                                     exact=method.tolerance.indicator is not None))
            verdict = criterion(fields, local, measures)
            m, bound, laws = measures(), verdict.bound, verdict.laws
            sweeps += verdict.sweeps * share
            event = Iteration(
                iteration, d.setup_sweeps + sweeps, watch.total, m.indicator, m.displacement_jump, m.force_imbalance,
                m.residual, bound.relative, *m.counts, (criterion.name, criterion.value),
                best, m.macro_imbalance,
                true_error(fields, bound) if true_error else math.nan,
                *((laws.largest, laws.penetration, laws.tension, laws.cone, laws.direction) if laws else ()),
                discretisation_error=getattr(criterion, "discretisation_error", math.nan),
            )
        history.append(replace(event, state=event.state[:0]))  # the states themselves are large
        for subscriber in subscribers:
            subscriber(event)
        if verdict.met:
            converged, reason = True, "converged"
        elif not np.isfinite(event.residual) or moved > RUNAWAY * reach > 0:
            reason = "diverged"
        elif _stalled(history):
            reason = "stagnated at rounding"
        elif iteration < last:
            with watch("acceleration"):
                s = acceleration.next()
                if method.skip.frozen:
                    frozen = criterion.done
                    s[:, frozen] = evaluated.s[:, frozen]  # the answers to what was asked before are remembered
                    left_out += int(frozen.sum())
            continue
        break
    with watch("bound"):
        final = criterion.final(fields, bound)
        sweeps += final.sweeps * share if final is not bound else 0
    return Outcome(fields, local, final, converged, reason, iteration, sweeps, event, history, left_out)


def make_acceleration(d: Decomposition, method) -> Relaxation | ResidualMinimisation | Anderson:
    """The acceleration that a configuration asks for, in the norm of the inverse search direction.

    ``relaxation: auto`` is 1 where the residual is minimised over affine maps and 0.8 with contact. Where
    it is not minimised at all it is 0.8 (the paper's), or less if the two search directions differ much.
    """
    weight, auto = 1 / d.stage.direction.diagonal, method.relaxation == "auto"
    memory = None if method.memory == "auto" else method.memory
    if method.acceleration == "none":
        return Relaxation(_stable_relaxation(d) if auto else method.relaxation)
    if d.all_perfect:
        return ResidualMinimisation(weight, None if method.acceleration == "gmres" else memory,
                                    1.0 if auto else method.relaxation, d.space.team)
    return Anderson(weight, memory or CONTACT_MEMORY, 0.8 if auto else method.relaxation, d.space.team)


def _stable_relaxation(d: Decomposition) -> float:
    """For the worst eigenvalues of all ranks: k⁻ and k⁺ do not couple interfaces."""
    low, high = d.local.conditioning()
    high, low = d.space.team.max(high, -low)
    return stable_relaxation(-low, high)


def stable_relaxation(low: float, high: float) -> float:
    """0.8, or 0.9 of the limit 2/(1 + max(λ, 1/λ)) where that is less; λ the eigenvalues of (k⁻, k⁺)."""
    worst = max(high, 1 / low if low > 0 else np.inf)
    return max(min(0.8, 0.9 * 2 / (1 + worst)), 0.01)


def _stalled(history: list[Iteration]) -> bool:
    """Rounding has been reached and nothing improves any more."""
    if len(history) <= STALL or history[-1].residual > ROUNDING:
        return False
    recent = min(e.residual for e in history[-STALL:])
    return recent > 0.5 * min(e.residual for e in history[:-STALL])
