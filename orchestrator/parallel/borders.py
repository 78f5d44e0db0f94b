"""Sums at nodes on the borders between ranks, where what surrounds a node is on both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.parallel.team import ALONE, Team


class Borders:
    """Completes sums at some of a rank's places by what other ranks have there; every rank makes one, and calls it as often.

    Parameters
    ----------
    names : (k, c) numbers that are the same on every rank that has such a place, and differ from place to place
    at : (k,) int, where each is among this rank's places

    Notes
    -----
    What is exchanged is of the size of all borders, summed on every rank: right for some dozens of ranks.
    """

    def __init__(self, names: np.ndarray, at: np.ndarray, team: Team = ALONE):
        self.team, self._at = team, at
        everyone = team.all_gather(np.asarray(names, float))
        unique, place = np.unique(np.concatenate(everyone), axis=0, return_inverse=True)
        begin = sum(map(len, everyone[: team.rank]))
        self._place, self._count = place.ravel()[begin : begin + len(names)], len(unique)

    def __call__(self, sums: np.ndarray) -> np.ndarray:
        """The same array (..., places), completed in place."""
        if self.team.size > 1:
            total = np.zeros((*sums.shape[:-1], self._count))
            total[..., self._place] = sums[..., self._at]
            total, = self.team.sum(total)
            sums[..., self._at] = total[..., self._place]
        return sums


@dataclass(frozen=True)
class Meeting:
    """Where a rank's part of a mesh meets those of others.

    Parameters
    ----------
    label : (n,) int, what a node is called on all ranks; nodes of a rank that are one, see ``Fields.joined``, share it
    shared : (n,) bool, whether cells of other ranks have it too
    """

    label: np.ndarray
    shared: np.ndarray
    team: Team

    def borders(self, node: np.ndarray, *properties: np.ndarray) -> Borders:
        """Of places at nodes (K,); properties (K,) or (K, …) tell places at a node from each other."""
        at = np.flatnonzero(self.shared[node])
        return Borders(np.column_stack([self.label[node[at]], *(p[at] for p in properties)]), at, self.team)
