"""What the iterations end with: the input of all that is delivered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from orchestrator.method.events import Iteration
from orchestrator.method.history import History
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.local.state import LocalState
from orchestrator.method.stopping.bound import Bound
from orchestrator.method.stopping.far_bodies import FarBody
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
    frozen : load steps that took no part in a linear stage because they were accurate enough, summed over the stages
    far : bodies beyond small displacements, see ``stopping.far_bodies``
    paired : per load step, where sides are paired anew as they slide; else empty
    open : (bodies, T) how far the places of loose bodies are open, see ``stopping.places``; None where nothing is stabilised
    gave_way : iterations after which springs of stabilisation have given way, see ``stopping.giving_way``
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
    far: list[FarBody] = field(default_factory=list)
    paired: list[Paired] = field(default_factory=list)
    open: np.ndarray | None = None
    gave_way: list[int] = field(default_factory=list)

    @classmethod
    def joined(cls, batches: Sequence[Iterated]) -> Iterated:
        """Of all load steps from batches of them, in order; the reason is that of the first failure."""
        if len(batches) == 1:
            return batches[0]
        decisive = next((b for b in batches if not b.converged), batches[-1])
        return cls(
            Admissible.joined([b.fields for b in batches]), LocalState.joined([b.local for b in batches]),
            Bound.joined([b.bound for b in batches]), decisive.converged, decisive.stop_reason,
            batches[-1].iterations, batches[-1].sweeps, decisive.last,
            [event for b in batches for event in b.history], sum(b.frozen for b in batches),
            [body for b in batches for body in b.far], [paired for b in batches for paired in b.paired],
            None if any(b.open is None for b in batches) else np.concatenate([b.open for b in batches], axis=1),
            [iteration for b in batches for iteration in b.gave_way])
