"""Rank 0's view of several ranks: states for its subscribers, fields of the interfaces of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.method.checkpoint import COMMON, Numbers, kind_of
from orchestrator.method.delivery.interface_fields import ALONG, InterfaceFields
from orchestrator.method.events import Finished, Iteration, Subscriber, Subscribers
from orchestrator.parallel.team import Team


def interfaces_of_all(own: InterfaceFields | None, team: Team) -> InterfaceFields | None:
    """Return the fields of all ranks' interfaces, in the order of the scene, on rank 0; elsewhere
    its own.
    """
    told = team.gather(own)
    if own is None or told is None or len(told) == 1:
        return own
    nodes, names = (np.cumsum([0, *(len(getattr(x, of)) for x in told)])
                    for of in ("nodes", "names"))
    told = [replace(x, triangles=x.triangles + node, owner=x.owner + name)
            for x, node, name in zip(told, nodes, names)]
    every = {name: np.concatenate([getattr(x, name) for x in told], axis=axis)
             for name, (_, axis) in ALONG.items() if getattr(own, name) is not None}
    offsets = np.append(0, np.cumsum(np.concatenate([np.diff(x.offsets) for x in told])))
    variables = {name: np.concatenate([x.own[name] for x in told], axis=1) for name in own.own}
    joined = replace(own, **every, offsets=offsets, own=variables)
    return joined.some(np.argsort(joined.index))


class OnRanks(Subscriber):
    """Rank 0's subscribers, on all ranks: states and checkpoints come together for who wants them.

    The volume is that of all traces, to one rank: right for some hundreds of ranks.

    numbers : which columns of the whole scene's arrays are this rank's
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.team, self.told = team, Subscribers(subscribers)
        wanted = [any(s.wants_states for s in subscribers),
                  any(s.wants_checkpoints for s in subscribers)]
        self.wanted = team.share(wanted if team.size > 1 else [False, False])
        self.numbers = team.gather(numbers)

    def iteration(self, event: Iteration) -> None:
        states, checkpoints = self.wanted
        if states:
            event = replace(event, state=self._whole("trace", event.state))
        if checkpoints and event.checkpoint is not None:
            arrays = {name: self._whole(kind_of(name), x)
                      for name, x in event.checkpoint.arrays.items()}
            event = replace(event, checkpoint=replace(event.checkpoint, arrays=arrays))
        self.told.iteration(event)

    def _whole(self, kind: str, part: np.ndarray) -> np.ndarray | None:
        """Return on rank 0 an array of the whole scene, from every rank's columns."""
        if kind == COMMON:
            return part
        arrived = self.team.gather(part)
        if arrived is None:
            return None
        columns = [own[kind] for own in self.numbers]
        whole = np.zeros((len(part), 1 + max(own.max(initial=-1) for own in columns)), part.dtype)
        for theirs, own in zip(arrived, columns):
            whole[:, own] = theirs
        return whole

    def warned(self, sentence: str) -> None:
        self.told.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.told.finished(event)
