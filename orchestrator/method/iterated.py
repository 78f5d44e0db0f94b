"""What the iterations end with: the input of all that is delivered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.evaluation import Evaluation
from orchestrator.method.events import Iteration
from orchestrator.method.history import History
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.latin import Latin
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.bound import Bound
from orchestrator.scene.interfaces.mortar.operators import Mortar


@dataclass(frozen=True)
class Paired:
    """How sides that slide on each other were paired in a load step.

    pairs : that are not perfect
    mortars : operators by the interface's place in the scene
    before : what the load step before has left
    """

    pairs: Pairs
    mortars: dict[int, Mortar]
    before: History


@dataclass(frozen=True)
class Iterated:
    """What the iterations ended with, this rank's part.

    fields : best admissible fields
    local : the last local stage
    bound : their error bound, energy and continuity
    converged, stop_reason : and why
    iterations : linear stages after set-up
    sweeps : back-substitutions per subdomain and load step, iterations alone
    last : the last event
    history : all events, without their states
    found : monitor's name → what it has found, case after case
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
    found: Mapping[str, list[Any]] = field(default_factory=dict)

    @classmethod
    def joined(cls, increments: Sequence[Iterated]) -> Iterated:
        """Of all load steps from increments of them, in order; the reason is that of the first failure."""
        if len(increments) == 1:
            return increments[0]
        decisive, final = next((x for x in increments if not x.converged), increments[-1]), increments[-1]
        return cls(Admissible.joined([x.fields for x in increments]), LocalState.joined([x.local for x in increments]),
            Bound.joined([x.bound for x in increments]), decisive.converged, decisive.stop_reason, final.iterations, final.sweeps,
            decisive.last, [event for x in increments for event in x.history],
            {name: [found for x in increments for found in x.found[name]] for name in increments[0].found})

    def by_pairing(self, d: Decomposition) -> Iterator[tuple[slice, Pairs, History]]:
        """Load steps of a decomposition in which the same pairs meet, these, and what the step before has left; the scene has
        their operators meanwhile."""
        if d.following is None:
            yield slice(0, d.steps), d.local.pairs, d.local.before
        for step, paired in enumerate(self.found.get("following", [])):
            for i in d.following.interfaces:
                i.mortar = paired.mortars[i.index]
            yield slice(step, step + 1), paired.pairs, paired.before


def event_of(now: Evaluation, sweeps: float, seconds: float) -> Iteration:
    """What is told of an iteration, once the next state is known.

    sweeps, seconds : spent in iterations, and in all
    """
    measures, told, coarse = now.measures, dict(now.verdict.told), now.problem.coarse
    target, laws = told.pop("target", ("", np.nan)), told.pop("laws", {})
    values = {"iteration": now.number, "sweeps": now.problem.made.sweeps + sweeps, "seconds": seconds, **measures.values, **told}
    if coarse is not None:
        values |= {"newton_steps": coarse.problem.newton_steps, "coarse_left": max(coarse.problem.left.values(), default=0.0)}
    return Iteration(values, target, now.best.s, measures.counts, laws, {} if coarse is None else dict(coarse.problem.ends))


def delivered(latin: Latin, end: tuple[Admissible, LocalState, Iteration], why: tuple[bool, str], history: list[Iteration],
              known: Bound | None = None) -> Iterated:
    """What the iterations of an increment have ended with.

    end : fields, local stage and event
    why : whether they have converged, and the reason
    known : the bound of the fields, as far as it is known
    """
    problem, (fields, local, event) = latin.problem, end
    bound = problem.bounded(fields, known)
    if bound is not known:
        latin.sweeps += bound.sweeps * problem.steps / problem.scene.steps
    event = replace(event, checkpoint=None)
    return Iterated(fields, local, bound, *why, latin.number, latin.sweeps, event, history or [event.without_state()],
                    {monitor.name: monitor.found(problem) for monitor in latin.monitors})
