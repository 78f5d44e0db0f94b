"""Events of a run, for those who listen: history, progress, checkpoint, and subscribers of the
user's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np


# What every history has; columns for further statuses, for the laws' measures and for what else
# monitors tell follow.
COUNTED = ("open", "stick", "slip")
HISTORY_COLUMNS = [
    "iteration", "sweeps", "seconds", "indicator", "displacement_jump", "force_imbalance",
    "residual", "error_bound", *COUNTED,
    "macro_imbalance", "true_error", "law_residual", "tolerance", "discretisation_error",
    "newton_steps", "coarse_left",
    "far_bodies",
]
_UNTOLD = dict.fromkeys(HISTORY_COLUMNS, math.nan) | {"newton_steps": 0, "far_bodies": 0}


@dataclass(frozen=True)
class Iteration:
    """One finished iteration; ``row`` goes to history.csv.

    values : name → number, each an attribute too:

        - iteration: linear stages after set-up; sweeps: back-substitutions per subdomain and load
          step so far, set-up included; seconds: since the run began
        - indicator: the paper's η, eq. 16, a squared ratio; displacement_jump: ‖B w‖ relative,
          weighted by the search direction; force_imbalance: ‖A f‖ relative, weighted by its
          inverse; residual: ‖s_new − s‖ relative
        - macro_imbalance: largest size of Cᵀf over the interfaces, relative; 0 to rounding, eq. 17
        - error_bound: guaranteed bound on the relative energy error; true_error: against the
          undecomposed solution; law_residual: the largest measure of ``law_residuals``;
          discretisation_error: latest estimate, relative, energy norm; nan where there is none
        - coarse_left: imbalance that the coarse contact problem left, over that at its start, of
          the worst load step; newton_steps: of it so far, all load steps together
        - far_bodies: bodies that have moved further than small displacements allow, and still are
          there
        - what further monitors tell; each has a column
    target : name and value of what the run waits for, e.g. ("error_bound", 1e-6)
    state : (steps, dofs) the best state s so far
    counts : name of a status → node pairs that have it, summed over the steps
    laws : the interface laws' own measures, by name
    coarse_ends : how the coarse contact problem's solves have ended so far → how many, see
        ``CoarseProblem``
    checkpoint : all that has to be known to go on after this iteration, see
        ``checkpoint.Checkpoint``
    """

    values: Mapping[str, float]
    target: tuple[str, float]
    state: np.ndarray
    counts: Mapping[str, int] = field(default_factory=dict)
    laws: Mapping[str, float] = field(default_factory=dict)
    coarse_ends: Mapping[str, int] = field(default_factory=dict)
    checkpoint: object = None

    def __getattr__(self, name: str) -> float:
        known = _UNTOLD | dict(self.__dict__.get("values", {}))
        if name not in known:
            raise AttributeError(f"an iteration has no {name}")
        return known[name]

    @classmethod
    def of_content(cls, content: Mapping[str, Any], state: np.ndarray) -> Iteration:
        """The event that ``content`` was made from."""
        return cls(**{**content, "target": tuple(content["target"])}, state=state)

    @property
    def content(self) -> dict[str, Any]:
        """All but state and checkpoint: numbers and texts."""
        return {f.name: getattr(self, f.name) for f in fields(self)
                if f.name not in ("state", "checkpoint")}

    def without_state(self) -> Iteration:
        """Leave out the arrays, which are large, and views hold them."""
        return replace(self, state=self.state[:0].copy(), checkpoint=None)

    @property
    def tolerance(self) -> float:
        """The value that the run waits for; with ``error: auto`` it follows the estimate."""
        return self.target[1]

    @property
    def row(self) -> dict[str, float]:
        """Column → value: ``HISTORY_COLUMNS``, then other statuses that the laws know, their
        measures, what else monitors tell.
        """
        known = {**dict.fromkeys(COUNTED, 0), **self.counts, **self.laws, **self.values}
        return {**{name: known[name] if name in known else getattr(self, name)
                   for name in HISTORY_COLUMNS}, **known}


@dataclass(frozen=True)
class Finished:
    """The iterations have ended: ``stop_reason`` is "converged", "max_iterations", "diverged",
    "stagnated …".
    """

    converged: bool
    stop_reason: str
    iterations: int


class Subscriber:
    """Hears what goes on in a run. All methods are optional: override those of use.

    They are called in the thread of the run, which waits for them; an exception ends it. Events are
    shared by all who listen: their arrays must not be changed, and are to be copied if they are
    kept. Of several ranks, only rank 0 has subscribers.

    wants_states : whether ``Iteration.state`` is needed: with several ranks, it is brought together
        for those alone who want it
    wants_checkpoints : the same of ``Iteration.checkpoint``

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
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [0, 0, 1]}]}),
    ...     subscribers=[Printer()])
    meshing
    assembling and factorising
    converged after 7
    """

    wants_states = wants_checkpoints = False

    def stage(self, name: str) -> None:
        """Something begins that is no iteration, such as "meshing" or "assembling and
        factorising".
        """

    def made(self, scene: object) -> None:
        """The scene is made that is solved."""

    def working(self, usage: object) -> None:
        """A black box begins its work: ``usage.doing`` says how far it is, in any thread."""

    def iteration(self, event: Iteration) -> None:
        """An iteration is done."""

    def warned(self, sentence: str) -> None:
        """Something is noticed that a user should know while it runs; the summary has it as
        well.
        """

    def finished(self, event: Finished) -> None:
        """The iterations have ended, converged or not; what is delivered is computed next."""

    def failed(self, error: BaseException) -> None:
        """The run has been interrupted or has failed, at whatever stage; ``error`` ends it after
        this.
        """


def _to_all(name: str) -> Callable[[Subscribers, object], None]:
    """The method of ``Subscribers`` that tells each of them in turn."""
    def tell(self: Subscribers, word: object) -> None:
        for subscriber in self.all:
            getattr(subscriber, name)(word)

    return tell


class Subscribers(Subscriber):
    """Several as one: each is told in turn."""

    def __init__(self, subscribers: Iterable[Subscriber] = ()):
        self.all = list(subscribers)

    stage, made, working, iteration, warned, finished, failed = map(
        _to_all, ("stage", "made", "working", "iteration", "warned", "finished", "failed"))
