"""The iterations of the multiscale LATIN method (Algorithm 1 of the paper, mended).

The loop emits events and knows nothing of files, of the code behind the black box, or of which
laws the interfaces follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.method.acceleration import Relaxation, ResidualMinimisation
from orchestrator.method.anderson import Anderson
from orchestrator.method.bound import Bound
from orchestrator.method.criteria import make_criterion
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Finished, Iteration
from orchestrator.method.indicator import (
    displacement_jump,
    force_imbalance,
    latin_indicator,
    macro_imbalance,
    residual_size,
)
from orchestrator.method.linear_stage import Admissible
from orchestrator.method.local_state import LocalState
from orchestrator.timing import Stopwatch

STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding
RUNAWAY = 1e6  # growth of the displacement that no convergent run shows
CONTACT_MEMORY = 15


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


def iterate(d: Decomposition, method, subscribers: Sequence[Callable], watch: Stopwatch,
            start: np.ndarray | None = None, first: int = 0, spent: float = 0.0,
            true_error: Callable | None = None) -> Outcome:
    """Alternate linear and local stages until the stopping criterion holds.

    Parameters
    ----------
    method : ``method`` of the configuration: acceleration, relaxation, tolerance, max_iterations
    subscribers : called with every ``Iteration`` and with ``Finished``
    start, first, spent : state (D, T), iteration number and sweeps to resume from
    true_error : (fields, bound) → relative energy error, where the exact solution is known
    """
    direction = d.stage.direction
    acceleration, criterion = make_acceleration(d, method), make_criterion(d, method.tolerance)
    s = np.zeros((d.space.size, d.scene.steps)) if start is None else start
    sweeps, history = spent, []
    iteration, converged, reason = first, False, "max_iterations"
    reach = 0.0  # largest interface displacement of the first stage
    while True:
        iteration += 1
        with watch("linear_stage"):
            sweeps += bool(s.any())
            evaluated = d.stage(s)
        reach = reach or np.abs(evaluated.w).max(initial=0.0)
        if d.coarse is not None:
            with watch("coarse"):
                evaluated = d.coarse(evaluated)
        with watch("local_stage"):
            local = d.local(evaluated.w, evaluated.f)
        with watch("acceleration"):
            residual, best, (u, alpha) = acceleration.best(evaluated.s, local.s, [evaluated.u, evaluated.alpha])
            fields = evaluated if best is evaluated.s else d.stage.complete(best, u, alpha)
        with watch("bound"):
            eta = latin_indicator(direction, d.local, fields, local, exact=method.tolerance.indicator is not None)
            verdict = criterion(fields, local, eta)
            bound, laws = verdict.bound, verdict.laws
            sweeps += bound.sweeps
            event = Iteration(
                iteration, d.setup_sweeps + sweeps, watch.total, eta, displacement_jump(direction, fields),
                force_imbalance(direction, fields), residual_size(direction, residual, best), bound.relative,
                *local.counts, criterion.target, best,
                macro_imbalance(d.stage.macro.C, fields) if d.stage.macro else math.nan,
                true_error(fields, bound) if true_error else math.nan,
                *((laws.largest, laws.penetration, laws.tension, laws.cone, laws.direction) if laws else ()),
            )
        history.append(event)
        for subscriber in subscribers:
            subscriber(event)
        if verdict.met:
            converged, reason = True, "converged"
        elif not np.isfinite(event.residual) or np.abs(evaluated.w).max(initial=0.0) > RUNAWAY * reach > 0:
            reason = "diverged"
        elif _stalled(history):
            reason = "stagnated at rounding"
        elif iteration < method.max_iterations:
            with watch("acceleration"):
                s = acceleration.next()
            continue
        break
    with watch("bound"):
        final = criterion.final(fields, bound)
        sweeps += final.sweeps if final is not bound else 0
    for subscriber in subscribers:
        subscriber(Finished(converged, reason, iteration))
    return Outcome(fields, local, final, converged, reason, iteration, sweeps, event, history)


def make_acceleration(d: Decomposition, method) -> Relaxation | ResidualMinimisation | Anderson:
    """The acceleration that a configuration asks for, in the norm of the inverse search direction.

    ``relaxation: auto`` is 1 where the residual is minimised over affine maps, 0.8 (the paper's) where
    it is not minimised at all, and with contact.
    """
    weight, auto = 1 / d.stage.direction.diagonal, method.relaxation == "auto"
    memory = None if method.memory == "auto" else method.memory
    if method.acceleration == "none":
        return Relaxation(0.8 if auto else method.relaxation)
    if d.all_perfect:
        return ResidualMinimisation(weight, None if method.acceleration == "gmres" else memory,
                                    1.0 if auto else method.relaxation)
    return Anderson(weight, memory or CONTACT_MEMORY, 0.8 if auto else method.relaxation)


def _stalled(history: list[Iteration]) -> bool:
    """Rounding has been reached and nothing improves any more."""
    if len(history) <= STALL or history[-1].residual > ROUNDING:
        return False
    recent = min(e.residual for e in history[-STALL:])
    return recent > 0.5 * min(e.residual for e in history[:-STALL])
