"""Brings the ranks' states together for the subscribers on rank 0."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.memory import Numbers
from orchestrator.parallel.team import Team

TOGETHER = 16 << 20  # bytes: more of them are no slower in several messages


def whole_states(subscribers: Sequence[Subscriber], numbers: Numbers, team: Team) -> Sequence[Subscriber]:
    """The subscribers, told of whole states and memories: the same ones where there is one rank.

    Parameters
    ----------
    numbers : which columns of the whole scene's arrays are this rank's
    """
    return subscribers if team.size == 1 else [WholeStates(subscribers, numbers, team)]


class WholeStates(Subscriber):
    """On every rank; tells those of rank 0, in the same iteration: what has arrived outlives the rank it came from.

    Notes
    -----
    The volume is some times that of all traces, to one rank: right for some hundreds of ranks.
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.keepers = Subscribers(s for s in subscribers if s.wants_states or s.wants_memory)
        self.others = Subscribers(s for s in subscribers if not (s.wants_states or s.wants_memory))
        self.team = team
        self.numbers = team.all_gather(numbers)
        self.wanted, self.states = team.share((bool(self.keepers.all), any(s.wants_states for s in self.keepers.all)))

    def iteration(self, event: Iteration) -> None:
        self.others.iteration(event)
        if not self.wanted:
            return
        whole: dict[str, np.ndarray] = {}
        for some in self._messages(({"trace/state": event.state} if self.states else {}) | event.memory.spread):
            whole |= self._gathered(some)
        if self.team.rank == 0:
            state = whole.pop("trace/state", event.state)
            self.keepers.iteration(replace(event, state=state, memory=event.memory.of_all(whole)))

    def _messages(self, arrays: dict[str, np.ndarray]) -> Iterator[dict[str, np.ndarray]]:
        """What travels together: all, unless rank 0 would have to hold more than ``TOGETHER`` of it twice; the same on all ranks."""
        size, some = 0, {}
        for name, array in arrays.items():
            more = 8 * len(array) * sum(len(numbers[name.partition("/")[0]]) for numbers in self.numbers)
            if some and size + more > TOGETHER:
                yield some
                size, some = 0, {}
            size, some[name] = size + more, array
        if some:
            yield some

    def _gathered(self, mine: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The whole scene's arrays, on rank 0, from every rank's columns of them, in one message; nothing elsewhere."""
        rows = {name: len(array) for name, array in mine.items()}
        kinds = {name: name.partition("/")[0] for name in rows}
        widths = [{name: len(numbers[kinds[name]]) for name in rows} for numbers in self.numbers]
        arrived = self.team.gather(np.concatenate([array.ravel() for array in mine.values()]))
        if arrived is None:
            return {}
        whole = {name: np.zeros((rows[name], 1 + max(n[kinds[name]].max(initial=-1) for n in self.numbers))) for name in rows}
        for part, width, numbers in zip(arrived, widths, self.numbers):
            ends = np.cumsum([rows[name] * width[name] for name in rows])
            for name, piece in zip(rows, np.split(part, ends[:-1])):
                whole[name][:, numbers[kinds[name]]] = piece.reshape(rows[name], width[name])
        return whole

    def warned(self, sentence: str) -> None:
        self.others.warned(sentence)
        self.keepers.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.keepers.finished(event)
        self.others.finished(event)
