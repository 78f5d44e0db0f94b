"""Which interfaces each rank adds up: every rank has as many node pairs to work on as can be."""

from __future__ import annotations

import numpy as np

from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.parallel.team import Team


def dealt(team: Team, own: np.ndarray, fields: PairFields) -> np.ndarray:
    """(I,) bool, which of the interfaces that this rank touches it adds up; of all ranks each interface is one's.

    Those that it alone touches are its own. Of those between two ranks the largest go first, each to the one that has less.

    own : (b,) int, the bodies of this rank
    """
    inside, index = np.isin(fields.ends, own).all(axis=1), np.array([i.index for i in fields.pairs.interfaces], dtype=int)
    pairs = np.diff(fields.pairs.bounds)
    everyones = team.all_gather((pairs[inside].sum(), index[~inside], pairs[~inside]))
    load = np.array([alone for alone, _, _ in everyones], float)
    between = np.concatenate([shared for _, shared, _ in everyones])
    size = np.concatenate([sizes for _, _, sizes in everyones])
    rank = np.repeat(np.arange(team.size), [len(shared) for _, shared, _ in everyones])
    order = np.lexsort((rank, between, -size))  # its two ranks one after the other
    mine = []
    for one, two in order.reshape(-1, 2):
        taker = min(rank[one], rank[two], key=load.__getitem__)
        load[taker] += size[one]
        if taker == team.rank:
            mine.append(between[one])
    return inside | np.isin(index, mine)
