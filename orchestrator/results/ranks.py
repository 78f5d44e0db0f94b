"""Rank 0's view of several ranks: states for its subscribers, fields of the interfaces of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.checkpoint import Numbers
from orchestrator.method.delivery.interface_fields import ALONG, InterfaceFields
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.parallel.team import Team


def interfaces_of_all(own: InterfaceFields | None, team: Team) -> InterfaceFields | None:
    """Return the fields of all ranks' interfaces, in the order of the scene, on rank 0; elsewhere its own."""
    told = team.gather(own)
    if own is None or told is None or len(told) == 1:
        return own
    nodes, names = (np.cumsum([0, *(len(getattr(x, of)) for x in told)]) for of in ("nodes", "names"))
    told = [replace(x, triangles=x.triangles + node, owner=x.owner + name) for x, node, name in zip(told, nodes, names)]
    every = {name: np.concatenate([getattr(x, name) for x in told], axis=axis)
             for name, (_, axis) in ALONG.items() if getattr(own, name) is not None}
    offsets = np.append(0, np.cumsum(np.concatenate([np.diff(x.offsets) for x in told])))
    variables = {name: np.concatenate([x.own[name] for x in told], axis=1) for name in own.own}
    joined = replace(own, **every, offsets=offsets, own=variables)
    return joined.some(np.argsort(joined.index))


class OnRanks(Subscriber):
    """Rank 0's subscribers, on all ranks: who wants checkpoints has a copy on each, who wants states gets the whole on rank 0.

    The volume of states is that of all traces, to one rank: right for some hundreds of ranks.

    numbers : which columns of the whole scene's arrays are this rank's
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.team, writers = team, team.share([s for s in subscribers if s.wants_checkpoints])
        self.told = Subscribers(writers if team.rank else subscribers)
        self.states = team.share(any(s.wants_states for s in subscribers)) and team.size > 1
        self.numbers = team.all_gather(numbers["trace"]) if self.states else []
        for writer in writers:
            writer.begins(team, numbers)

    def iteration(self, event: Iteration) -> None:
        whole = replace(event, state=self._whole(event.state)) if self.states else event
        for each in self.told.all:
            each.iteration(whole if each.wants_states else event)

    def _whole(self, state: np.ndarray) -> np.ndarray | None:
        """On rank 0, from every rank's columns."""
        arrived = self.team.gather(state)
        if arrived is None:
            return None
        whole = np.zeros((len(state), 1 + max(own.max(initial=-1) for own in self.numbers)))
        for part, own in zip(arrived, self.numbers):
            whole[:, own] = part
        return whole

    def warned(self, sentence: str) -> None:
        self.told.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.told.finished(event)
