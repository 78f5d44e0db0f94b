"""What the iterations end with: the input of all that is delivered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import Iteration
from orchestrator.method.history import History
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.bound import Bound
from orchestrator.scene.interfaces.mortar.operators import Mortar


@dataclass(frozen=True)
class Paired:
    """How sides that slide on each other were paired in a load step.

    Parameters
    ----------
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

    Parameters
    ----------
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
    def joined(cls, batches: Sequence[Iterated]) -> Iterated:
        """Of all load steps from batches of them, in order; the reason is that of the first failure."""
        if len(batches) == 1:
            return batches[0]
        decisive = next((b for b in batches if not b.converged), batches[-1])
        return cls(
            Admissible.joined([b.fields for b in batches]), LocalState.joined([b.local for b in batches]),
            Bound.joined([b.bound for b in batches]), decisive.converged, decisive.stop_reason,
            batches[-1].iterations, batches[-1].sweeps, decisive.last, [event for b in batches for event in b.history],
            {name: [x for b in batches for x in b.found[name]] for name in batches[0].found})

    def by_pairing(self, d: Decomposition) -> Iterator[tuple[slice, Pairs, History]]:
        """Load steps of a decomposition in which the same pairs meet, these, and what the step before has left; the scene has
        their operators meanwhile."""
        if d.following is None:
            yield slice(0, d.steps), d.local.pairs, d.local.before
        for step, paired in enumerate(self.found.get("following", [])):
            for i in d.following.interfaces:
                i.mortar = paired.mortars[i.index]
            yield slice(step, step + 1), paired.pairs, paired.before
