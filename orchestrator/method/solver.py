"""The multiscale LATIN method from scene to solution: set-up, iterations, recovery.

Mends Algorithm 1 of the paper; the loop emits events and knows nothing of files or of the code
behind the black box.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.blackbox.extended import extended_model, sides_of
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.acceleration import make_acceleration
from orchestrator.method.bound import Bound, ErrorBound
from orchestrator.method.events import Finished, Iteration
from orchestrator.method.indicator import (
    displacement_jump,
    force_imbalance,
    latin_indicator,
    macro_imbalance,
    residual_size,
)
from orchestrator.method.linear_stage import Admissible, LinearStage
from orchestrator.method.loading import Loading, RimStiffness, apply_loads, assemble_rims, boundary_stiffness
from orchestrator.method.local_stage import PerfectInterfaces
from orchestrator.method.macro import Macro
from orchestrator.method.macro_basis import interface_basis
from orchestrator.method.search_direction import assemble_search_direction
from orchestrator.method.traces import TraceSpace
from orchestrator.scene.model import Scene
from orchestrator.scene.rigid import rigid_modes
from orchestrator.scene.soles import Sole
from orchestrator.timing import Stopwatch

STALL = 20  # stages without progress at rounding level that end a run
ROUNDING = 1e-9  # residual below which lack of progress is blamed on rounding


@dataclass
class Decomposition:
    """All that is built once: a scene in the black box, ready to iterate."""

    scene: Scene
    blackbox: BlackBox
    space: TraceSpace
    traces: list[np.ndarray]
    rims: list[RimStiffness]
    loading: Loading
    stage: LinearStage
    local: PerfectInterfaces
    bound: ErrorBound
    modes: list[np.ndarray]
    node_counts: list[int]
    setup_sweeps: float

    def __repr__(self) -> str:
        macro = self.stage.macro
        return (f"Decomposition({len(self.scene.subdomains)} subdomains, {len(self.scene.interfaces)} interfaces, "
                f"{self.space.size} trace dofs, {macro.size if macro else 0} macro unknowns)")


def prepare(scene: Scene, soles: Sequence[tuple[Sole, Sole]], method, blackbox: BlackBox, workers: int,
            watch: Stopwatch) -> Decomposition:
    """Load the extended subdomains into the black box and build what the iterations need.

    Parameters
    ----------
    soles : per interface, the soles of its two sides
    method : ``method`` of the configuration
    workers : number of packets small requests are joined in

    Raises
    ------
    BlackBoxError : from the code
    InputError : the macro problem is singular
    """
    sides = [sides_of(scene, s.index) for s in scene.subdomains]
    models = [extended_model(scene, s, sides[s.index], soles) for s in scene.subdomains]
    traces = [m.trace for m in models]
    space = TraceSpace.of(scene, sides, traces)
    with watch("load"):
        blackbox.load(models)
    with watch("search_direction"):
        direction = assemble_search_direction(scene, space, soles, blackbox, workers)
        rims = assemble_rims(scene, sides, blackbox, workers)
    with watch("linear_stage"):
        loading = apply_loads(scene, space, models, traces, rims, blackbox)
    macro = None
    if method.macro.strategy != "none" and scene.interfaces:
        with watch("macro"):
            bases = [interface_basis(scene.mesh.nodes[i.global_nodes], i.free, method.macro.basis)
                     for i in scene.interfaces]
            macro = Macro(space, direction, bases, method.macro.strategy, blackbox)
    stage = LinearStage(space, direction, macro, loading.boundary, blackbox)
    with watch("bound"):
        modes = [rigid_modes(scene.mesh.nodes[s.nodes], s.fixed) for s in scene.subdomains]
        external = np.vstack([s.loads.reshape(scene.steps, -1)[:, t].T for s, t in zip(scene.subdomains, traces)])
        bound = ErrorBound(stage, loading, boundary_stiffness(space, traces, rims),
                           [m[t] for m, t in zip(modes, traces)], external)
    local = PerfectInterfaces(direction, method.search_direction.kplus)
    return Decomposition(scene, blackbox, space, traces, rims, loading, stage, local, bound, modes,
                         [len(m.nodes) for m in models], loading.sweeps + (macro.sweeps / scene.steps if macro else 0))


@dataclass
class Outcome:
    """What the iterations ended with.

    Parameters
    ----------
    fields : best admissible fields
    bound : their error bound
    converged, stop_reason : and why
    iterations : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step, iterations alone
    last : the last event
    """

    fields: Admissible
    bound: Bound
    converged: bool
    stop_reason: str
    iterations: int
    sweeps: float
    last: Iteration
    history: list[Iteration] = field(default_factory=list)


def iterate(d: Decomposition, method, subscribers: Sequence[Callable], watch: Stopwatch,
            start: np.ndarray | None = None, first: int = 0, true_error: Callable | None = None) -> Outcome:
    """Alternate linear and local stages until the stopping criterion holds.

    Parameters
    ----------
    method : ``method`` of the configuration: acceleration, relaxation, tolerance, max_iterations
    subscribers : called with every ``Iteration`` and with ``Finished``
    start, first : state (D, T) and iteration number to resume from
    true_error : (fields, bound) → relative energy error, where the exact solution is known
    """
    direction = d.stage.direction
    memory = None if method.memory == "auto" else method.memory
    acceleration = make_acceleration(method.acceleration, 1 / direction.diagonal, method.relaxation, memory)
    criterion = Criterion(method.tolerance, d.bound)
    s = np.zeros((d.space.size, d.scene.steps)) if start is None else start
    sweeps, history = 0.0, []
    iteration, converged, reason = first, False, "max_iterations"
    while True:
        iteration += 1
        with watch("linear_stage"):
            sweeps += bool(s.any())
            evaluated = d.stage(s)
        with watch("local_stage"):
            s_new = d.local(evaluated.w, evaluated.f)
        with watch("acceleration"):
            residual, best, (u, alpha) = acceleration.best(s, s_new, [evaluated.u, evaluated.alpha])
            fields = evaluated if best is s else d.stage.complete(best, u, alpha)
        with watch("bound"):
            met, bound = criterion(fields, d)
            sweeps += bound.sweeps
            event = Iteration(
                iteration, d.setup_sweeps + sweeps, watch.total, latin_indicator(direction, d.local, fields),
                displacement_jump(direction, fields), force_imbalance(direction, fields),
                residual_size(direction, residual, best), bound.relative, 0, 0, 0, criterion.target, best,
                macro_imbalance(d.stage.macro.C, fields) if d.stage.macro else math.nan,
                true_error(fields, bound) if true_error else math.nan,
            )
        history.append(event)
        for subscriber in subscribers:
            subscriber(event)
        if met:
            converged, reason = True, "converged"
        elif not np.isfinite(event.residual):
            reason = "diverged"
        elif _stalled(history):
            reason = "stagnated at rounding"
        elif iteration < method.max_iterations:
            with watch("acceleration"):
                s = acceleration.next()
            continue
        break
    if not np.isfinite(bound.relative):
        with watch("bound"):
            bound = d.bound(fields)
            sweeps += bound.sweeps
    for subscriber in subscribers:
        subscriber(Finished(converged, reason, iteration))
    return Outcome(fields, bound, converged, reason, iteration, sweeps, event, history)


class Criterion:
    """The named stopping criterion: ``error_bound`` or the paper's ``indicator``.

    The bound's second part costs back-substitutions. It is evaluated once the first part is below
    the tolerance, and again when the force imbalance has fallen enough to make a difference.
    """

    def __init__(self, tolerance, bound: ErrorBound):
        self.by_error = tolerance.error is not None
        self.value = tolerance.error if self.by_error else tolerance.indicator
        self.target = ("error_bound" if self.by_error else "indicator", self.value)
        self.bound, self.ratio = bound, 0.0

    def __call__(self, fields: Admissible, d: Decomposition) -> tuple[bool, Bound]:
        """Whether the criterion holds, and the bound as far as it was evaluated."""
        bound = self.bound(fields, complete=False)
        if not self.by_error:
            return latin_indicator(d.stage.direction, d.local, fields) <= self.value, bound
        imbalance = force_imbalance(d.stage.direction, fields)
        if bound.a <= self.value and self.ratio * imbalance <= self.value:
            bound = self.bound(fields)
            self.ratio = bound.relative / imbalance if np.isfinite(bound.relative) and imbalance > 0 else 0.0
        return bool(bound.relative <= self.value), bound


def _stalled(history: list[Iteration]) -> bool:
    """Rounding has been reached and nothing improves any more."""
    if len(history) <= STALL or history[-1].residual > ROUNDING:
        return False
    recent = min(e.residual for e in history[-STALL:])
    return recent > 0.5 * min(e.residual for e in history[:-STALL])
