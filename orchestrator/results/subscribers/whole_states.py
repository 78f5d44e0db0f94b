"""Brings the ranks' states together for the subscribers on rank 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.events import Finished, Iteration
from orchestrator.method.interface.traces import TraceSpace


def whole_states(subscribers: Sequence[Callable], space: TraceSpace) -> Sequence[Callable]:
    """The subscribers, told of whole states: the same ones where there is one rank."""
    return subscribers if space.team.size == 1 else [WholeStates(subscribers, space)]


class WholeStates:
    """Subscriber of every rank that tells those of rank 0, in the same iteration.

    Those that keep states (they have ``wants_states``) are told one iteration later: the parts travel
    while the next linear stage is solved, and what has arrived outlives the rank it came from.

    Notes
    -----
    The volume is that of all traces, to one rank: right for some hundreds of ranks.
    """

    def __init__(self, subscribers: Sequence[Callable], space: TraceSpace):
        self.keepers = [s for s in subscribers if getattr(s, "wants_states", False)]
        self.others = [s for s in subscribers if s not in self.keepers]
        self.team = space.team
        self.numbers = space.team.all_gather(space.number)
        self.under_way: tuple[Iteration, Callable] | None = None

    def __call__(self, event: Iteration | Finished) -> None:
        self._arrive()
        if isinstance(event, Iteration):
            steps = event.state.shape[1]
            self.under_way = event, self.team.gather_later(event.state, [len(n) * steps for n in self.numbers])
        else:
            self._tell(self.keepers, event)
        self._tell(self.others, event)

    def _arrive(self) -> None:
        if self.under_way is None:
            return
        event, parts = self.under_way[0], self.under_way[1]()
        self.under_way = None
        if parts is not None:
            state = np.empty((sum(map(len, self.numbers)), event.state.shape[1]))
            for number, part in zip(self.numbers, parts):
                state[number] = part.reshape(len(number), -1)
            self._tell(self.keepers, replace(event, state=state))

    @staticmethod
    def _tell(subscribers: Sequence[Callable], event: Iteration | Finished) -> None:
        for subscriber in subscribers:
            subscriber(event)
