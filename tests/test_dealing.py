"""Interfaces of the coarse contact problem are dealt out to the ranks."""

from types import SimpleNamespace

import numpy as np
from threads import among

from orchestrator.method.coarse.load_step import dealt


def test_ranks_add_up_as_many_pairs_and_each_interface_once():
    """A row of ten bodies, the first rank with most pairs of its own; of what lies between ranks others take more."""
    rng, owner = np.random.default_rng(1), np.array([0, 0, 0, 0, 1, 2, 1, 2, 1, 2])
    ends = np.array([(a, b) for a in range(10) for b in range(a + 1, 10) if b - a < 4])
    pairs = rng.integers(20, 90, len(ends))

    def of_rank(team):
        touched = np.flatnonzero((owner[ends] == team.rank).any(axis=1))
        given = SimpleNamespace(interfaces=[SimpleNamespace(index=i) for i in touched],
                                bounds=np.concatenate([[0], np.cumsum(pairs[touched])]))
        counted = dealt(team, np.flatnonzero(owner == team.rank), SimpleNamespace(ends=ends[touched], pairs=given))
        return touched[counted], pairs[touched[counted]].sum()

    found = among(3, of_rank)
    assert sorted(np.concatenate([counted for counted, _ in found])) == list(range(len(ends)))
    load = [total for _, total in found]
    assert max(load) - min(load) < pairs.max()
