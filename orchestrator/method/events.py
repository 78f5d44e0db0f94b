"""What a run tells those who listen: history, progress and checkpoint, and whoever else wants to know."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from orchestrator.method.memory import Memory


@dataclass(frozen=True)
class Iteration:
    """One finished iteration; ``row`` goes to history.csv.

    Parameters
    ----------
    iteration : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step so far, set-up included
    seconds : since the run began
    indicator : the paper's η, eq. 16, a squared ratio
    displacement_jump : ‖B w‖ relative, weighted by the search direction
    force_imbalance : ‖A f‖ relative, weighted by the inverse search direction
    residual : ‖s_new − s‖ relative
    error_bound : guaranteed bound on the relative energy error; nan when not evaluated
    counts : name of a status → node pairs that have it, summed over the steps
    target : name and value of what the run waits for, e.g. ("error_bound", 1e-6)
    macro_imbalance : largest size of Cᵀf over the interfaces, relative; 0 to rounding, eq. 17
    true_error : against the undecomposed solution, relative energy norm; nan without one
    law_residual : where interfaces are not perfect, the largest measure of ``law_residuals``
    laws : the interface laws' own measures among these, by name
    far_bodies : bodies that have moved further than small displacements allow, and still are there
    discretisation_error : latest estimate of it, relative, energy norm; nan where there is none yet
    coarse_left : imbalance that the coarse contact problem left, over that at its start, of the worst load step
    coarse_ends : how its solves have ended so far → how many, see ``CoarseProblem``
    newton_steps : of the coarse contact problem so far, all load steps together
    state : (steps, dofs) the best state s so far
    more : name → number, what further monitors tell; each has a column
    memory : all that has to be known to go on after this iteration as if nothing had happened
    """

    iteration: int
    sweeps: float
    seconds: float
    indicator: float
    displacement_jump: float
    force_imbalance: float
    residual: float
    error_bound: float
    target: tuple[str, float]
    state: np.ndarray
    macro_imbalance: float = math.nan
    true_error: float = math.nan
    law_residual: float = math.nan
    discretisation_error: float = math.nan
    newton_steps: int = 0
    coarse_left: float = math.nan
    far_bodies: int = 0
    coarse_ends: Mapping[str, int] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    laws: Mapping[str, float] = field(default_factory=dict)
    more: Mapping[str, float] = field(default_factory=dict)
    memory: Memory | None = None

    @property
    def tolerance(self) -> float:
        """The value that the run waits for; with ``error: auto`` it follows the estimate."""
        return self.target[1]

    @property
    def row(self) -> dict[str, float]:
        """Column → value: ``HISTORY_COLUMNS``, then other statuses that the laws know, their measures, what else monitors tell."""
        counts = dict.fromkeys(COUNTED, 0) | dict(self.counts)
        fixed = {name: counts.pop(name) if name in COUNTED else getattr(self, name) for name in HISTORY_COLUMNS}
        return {**fixed, **counts, **self.laws, **self.more}


# What every history has; columns for further statuses and for the laws' measures follow.
COUNTED = ("open", "stick", "slip")
HISTORY_COLUMNS = [
    "iteration", "sweeps", "seconds", "indicator", "displacement_jump", "force_imbalance",
    "residual", "error_bound", *COUNTED,
    "macro_imbalance", "true_error", "law_residual", "tolerance", "discretisation_error", "newton_steps", "coarse_left",
    "far_bodies",
]


@dataclass(frozen=True)
class Finished:
    """The iterations have ended: ``stop_reason`` is "converged", "max_iterations", "diverged", "stagnated …"."""

    converged: bool
    stop_reason: str
    iterations: int


class Subscriber:
    """Hears what goes on in a run. All methods are optional: override those of use.

    They are called in the thread of the run, which waits for them; an exception ends it. Events are shared by
    all who listen: their arrays must not be changed, and are to be copied if they are kept. Of several ranks,
    only rank 0 has subscribers.

    Attributes
    ----------
    wants_states : whether ``Iteration.state`` and ``Iteration.memory`` are needed. With several ranks, they are
        brought together for those alone who want them
    wants_memory : whether the latter is: of states such a one may hear rank 0's part alone

    Examples
    --------
    >>> from orchestrator import Subscriber, config_from, solve
    >>> class Printer(Subscriber):
    ...     def stage(self, name):
    ...         print(name)
    ...     def finished(self, event):
    ...         print(event.stop_reason, "after", event.iterations)
    >>> solution = solve(config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [0, 0, 1]}]}),
    ...     subscribers=[Printer()])
    meshing
    assembling and factorising
    converged after 12
    """

    wants_states = wants_memory = False

    def stage(self, name: str) -> None:
        """Something begins that is no iteration, such as "meshing" or "assembling and factorising"."""

    def iteration(self, event: Iteration) -> None:
        """An iteration is done."""

    def warned(self, sentence: str) -> None:
        """Something is noticed that a user should know while it runs; the summary has it as well."""

    def finished(self, event: Finished) -> None:
        """The iterations have ended, converged or not; what is delivered is computed next."""

    def failed(self, error: BaseException) -> None:
        """The run has been interrupted or has failed, at whatever stage; ``error`` ends it after this."""


class Subscribers(Subscriber):
    """Several as one: each is told in turn."""

    def __init__(self, subscribers: Iterable[Subscriber] = ()):
        self.all = list(subscribers)

    def stage(self, name: str) -> None:
        for subscriber in self.all:
            subscriber.stage(name)

    def iteration(self, event: Iteration) -> None:
        for subscriber in self.all:
            subscriber.iteration(event)

    def warned(self, sentence: str) -> None:
        for subscriber in self.all:
            subscriber.warned(sentence)

    def finished(self, event: Finished) -> None:
        for subscriber in self.all:
            subscriber.finished(event)

    def failed(self, error: BaseException) -> None:
        for subscriber in self.all:
            subscriber.failed(error)
