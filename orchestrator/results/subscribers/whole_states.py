"""Brings the ranks' states together for the subscribers on rank 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.interface.traces import TraceSpace


def whole_states(subscribers: Sequence[Subscriber], space: TraceSpace) -> Sequence[Subscriber]:
    """The subscribers, told of whole states: the same ones where there is one rank."""
    return subscribers if space.team.size == 1 else [WholeStates(subscribers, space)]


class WholeStates(Subscriber):
    """On every rank; tells those of rank 0, in the same iteration.

    Those that want states are told one iteration later: the parts travel while the next linear stage is solved,
    and what has arrived outlives the rank it came from.

    Notes
    -----
    The volume is that of all traces, to one rank: right for some hundreds of ranks.
    """

    def __init__(self, subscribers: Sequence[Subscriber], space: TraceSpace):
        self.keepers = Subscribers(s for s in subscribers if s.wants_states)
        self.others = Subscribers(s for s in subscribers if not s.wants_states)
        self.team = space.team
        self.numbers = space.team.all_gather(space.number)
        self.under_way: tuple[Iteration, Callable] | None = None

    def iteration(self, event: Iteration) -> None:
        self._arrive()
        steps = len(event.state)
        self.under_way = event, self.team.gather_later(event.state, [len(n) * steps for n in self.numbers])
        self.others.iteration(event)

    def finished(self, event: Finished) -> None:
        self._arrive()
        self.keepers.finished(event)
        self.others.finished(event)

    def _arrive(self) -> None:
        if self.under_way is None:
            return
        event, parts = self.under_way[0], self.under_way[1]()
        self.under_way = None
        if parts is not None:
            state = np.empty((len(event.state), sum(map(len, self.numbers))))
            for number, part in zip(self.numbers, parts):
                state[:, number] = part.reshape(-1, len(number))
            self.keepers.iteration(replace(event, state=state))
