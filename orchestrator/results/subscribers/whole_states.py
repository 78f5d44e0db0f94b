"""Brings the ranks' states together for the subscribers on rank 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.method.memory import Numbers
from orchestrator.parallel.team import Team


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
        self.keepers = Subscribers(s for s in subscribers if s.wants_states)
        self.others = Subscribers(s for s in subscribers if not s.wants_states)
        self.team = team
        self.numbers = team.all_gather(numbers)
        self.wanted = team.share(bool(self.keepers.all))

    def iteration(self, event: Iteration) -> None:
        self.others.iteration(event)
        if not self.wanted:
            return
        mine = {"trace/state": event.state, **event.memory.spread}
        everyone = self._gathered(mine)
        if everyone is not None:
            memory = event.memory.of_all(self.numbers, everyone)
            state = memory.arrays.pop("trace/state")
            self.keepers.iteration(replace(event, state=state, memory=memory))

    def _gathered(self, mine: Mapping[str, np.ndarray]) -> list[dict[str, np.ndarray]] | None:
        """Per rank, its columns of the arrays; all travel in one message."""
        rows = {name: len(array) for name, array in mine.items()}
        widths = [{name: len(numbers[name.partition("/")[0]]) for name in rows} for numbers in self.numbers]
        arrived = self.team.gather_later(np.concatenate([array.ravel() for array in mine.values()]),
                                         [sum(rows[name] * width[name] for name in rows) for width in widths])()
        if arrived is None:
            return None
        result = []
        for part, width in zip(arrived, widths):
            ends = np.cumsum([rows[name] * width[name] for name in rows])
            result.append({name: piece.reshape(rows[name], width[name])
                           for name, piece in zip(rows, np.split(part, ends[:-1]))})
        return result

    def warned(self, sentence: str) -> None:
        self.others.warned(sentence)
        self.keepers.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.keepers.finished(event)
        self.others.finished(event)
