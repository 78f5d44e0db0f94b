"""Points and nodes of other ranks that may meet a rank's own by way of others, and how values there
travel.

Points that share nodes by way of others are a group, and every rank that has a point of one answers
all of it: alike, since it is told all of it. Each rank tells all others of what may belong to a
group of several: a few points along the edges of interfaces between ranks, or all of interfaces
whose nodes do not match.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.answering import LawPoints
from orchestrator.method.interface.node_points import labelled, NodePoints
from orchestrator.parallel.team import ALONE, Team


@dataclass(frozen=True)
class Visits:
    """How values travel to all other ranks, which have them behind their own.

    sends : (k,) int, which of this rank's values it tells
    counts : rank → how many another one tells
    """

    team: Team = ALONE
    sends: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    counts: dict[int, int] = field(default_factory=dict)

    def __call__(self, *values: np.ndarray) -> list[np.ndarray]:
        """Return (rows, behind) of each of some values (rows, own), in one message; all ranks ask
        together.
        """
        told = np.concatenate([x[:, self.sends] for x in values])
        room = {r: np.empty((len(told), count)) for r, count in self.counts.items() if count}
        arrived = self.team.exchange({r: told for r in self.counts if told.shape[1]}, room)
        behind = np.hstack([told[:, :0], *(arrived[r] for r in room)])
        return np.split(behind, np.cumsum([len(x) for x in values])[:-1])


def completed(known: NodePoints, team: Team) -> tuple[NodePoints, Visits, Visits]:
    """Return points with those behind, own nodes first, and how values at points (by ``place``) and
    at nodes travel.

    known : what this rank knows; all ranks ask together
    """
    if team.size == 1:
        return known, Visits(), Visits()
    label = labelled(known.B, known.C.any(axis=(1, 2)) | ~known.own)
    opened = known.some(np.flatnonzero(np.isin(label, label[known.between])))
    tables = {r: t for r, t in enumerate(team.all_gather(opened)) if r != team.rank}
    told = {r: t.some(np.flatnonzero(t.mine)) for r, t in tables.items()}
    name = np.concatenate([known.node[known.own], *(t.node[t.own] for t in tables.values())])
    parts = [known, *told.values()]
    whole = replace(known, node=name,
                    B=_stacked([(t.B, places(name, t.node)) for t in parts], len(name)),
                    C=np.concatenate([known.C[known.own], *(t.C[t.own] for t in tables.values())]),
                    own=np.arange(len(name)) < known.own.sum(),
                    laws=LawPoints.joined([t.laws for t in parts]),
                    **{each: np.concatenate([getattr(t, each) for t in parts], axis=axis)
                       for each, axis in (
                        ("point", 0), ("apart", 0), ("between", 0), ("mine", 0), ("slid", 1))})
    own = places(known.node[known.own], opened.node[opened.own])
    return (whole,
            Visits(team, opened.place[opened.mine], {r: len(t.point) for r, t in told.items()}),
            Visits(team, own, {r: int(t.own.sum()) for r, t in tables.items()}))


def _stacked(parts: list[tuple[sp.csr_array, np.ndarray]], nodes: int) -> sp.csr_array:
    """(3P, 3M) B of points part after part; each comes with the place (m,) of its nodes among M,
    −1: nowhere.
    """
    total, start, entries = sum(B.shape[0] // 3 for B, _ in parts), 0, []
    for B, place in parts:
        count, B = max(B.shape[0] // 3, 1), B.tocoo()
        i, j = (x.astype(int) for x in B.coords)
        there = place[j // 3] >= 0
        entries.append(
            [x[there]
             for x in (B.data, i // count * total + start + i % count, 3 * place[j // 3] + j % 3)])
        start += B.shape[0] // 3
    data, i, j = (np.concatenate(x) for x in zip(*entries))
    return sp.csr_array((data, (i, j)), shape=(3 * total, 3 * nodes))


def places(names: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return (m,) int, where names (n, c) have each of those wanted (m, c); −1: they have not."""
    found = np.unique(np.concatenate([names, wanted]), axis=0, return_inverse=True)[1].ravel()
    place = np.full(int(found.max(initial=-1)) + 1, -1)
    place[found[: len(names)]] = np.arange(len(names))
    return place[found[len(names):]]
