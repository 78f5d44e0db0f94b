"""Brings the ranks' states together for the subscribers on rank 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.checkpoint import COMMON, Numbers, kind_of
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.parallel.team import Team


def whole_states(subscribers: Sequence[Subscriber], numbers: Numbers, team: Team) -> Sequence[Subscriber]:
    """The subscribers, told of whole states and checkpoints: the same ones where there is one rank.

    numbers : which columns of the whole scene's arrays are this rank's
    """
    return subscribers if team.size == 1 else [WholeStates(subscribers, numbers, team)]


class WholeStates(Subscriber):
    """On every rank; tells those of rank 0, in the same iteration: what has arrived outlives the rank it came from.

    The volume is some times that of all traces, to one rank: right for some hundreds of ranks.
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.keepers = Subscribers(s for s in subscribers if s.wants_states or s.wants_checkpoints)
        self.others = Subscribers(s for s in subscribers if not (s.wants_states or s.wants_checkpoints))
        self.team, self.numbers = team, team.all_gather(numbers)
        self.wanted, self.states = team.share((bool(self.keepers.all), any(s.wants_states for s in self.keepers.all)))

    def iteration(self, event: Iteration) -> None:
        self.others.iteration(event)
        if not self.wanted:
            return
        kept = event.checkpoint
        mine = ({"trace/state": event.state} if self.states else {}) | {
            name: array for name, array in kept.arrays.items() if kind_of(name) != COMMON}
        whole = self._gathered(mine)
        if self.team.rank == 0:
            state = whole.pop("trace/state", event.state)
            self.keepers.iteration(replace(event, state=state, checkpoint=replace(kept, arrays={**kept.arrays, **whole})))

    def _gathered(self, mine: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The whole scene's arrays, on rank 0, from every rank's columns of them, in one message; nothing elsewhere."""
        arrived, whole = self.team.gather(mine), {}
        if arrived is None:
            return {}
        for name, array in mine.items():
            columns = [numbers[kind_of(name)] for numbers in self.numbers]
            whole[name] = np.zeros((len(array), 1 + max(own.max(initial=-1) for own in columns)))
            for part, own in zip(arrived, columns):
                whole[name][:, own] = part[name]
        return whole

    def warned(self, sentence: str) -> None:
        self.others.warned(sentence)
        self.keepers.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.keepers.finished(event)
        self.others.finished(event)
