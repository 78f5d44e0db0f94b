"""Numbers and sums of things that ranks have in parts, as one process would give them, without an
array of all; and what is one and the same over several ranks.

At places on the borders each rank exchanges with those that have the same places, and with no
other. Who has a place finds the others by a rendezvous: a hash of its name says which rank is told
of it, and that one tells all who have asked.

Which rank owns which subdomain: equal cost, and few interface dofs between ranks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import wrong
from orchestrator.optional import Late
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.mesh.faces import components, runs
from orchestrator.scene.model import Scene
from orchestrator.timing import predicted_cost


def classes(names: np.ndarray, one: np.ndarray, two: np.ndarray, across: Mapping[int, np.ndarray],
            team: Team) -> np.ndarray:
    """(n,) int, the lowest name in the class of each of this rank's things; all ranks ask together.

    A class goes from rank to rank by way of its neighbours, a round of messages for each that lies
    between: on meshes a few.

    names : (n,) int below 2⁵³, no two alike on all ranks
    one, two : (k,) int, things of this rank that are one
    across : rank → (m,) int, things of this rank that are one with that rank's, which has its own
        in the same order; −1: none is
    """
    count, label = components(one, two, len(names))
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, label, names)
    changed = team.size > 1
    while changed:
        outgoing = {rank: np.where(at >= 0, lowest[label[at]], np.inf) if len(label)
                    else np.full(len(at), np.inf)
                    for rank, at in across.items()}
        arrived, before = team.exchange(outgoing,
                                        {rank: np.empty(len(at))
                                         for rank, at in across.items()}), lowest.copy()
        for rank, at in across.items():
            np.minimum.at(lowest, label[at[at >= 0]], arrived[rank][at >= 0])
        changed = bool(team.max(float((lowest < before).any()))[0])
    return lowest[label].astype(int)


@dataclass
class Link:
    """Exchange of a rank's part with others.

    number, boundary_number : (D,) and (B,) int, its trace dofs and boundary dofs in the whole scene
    total, subdomain_count : trace dofs and subdomains of the whole scene
    sends, receives : rank → (k,) int, trace dofs that a neighbour gets, and ghosts that it gives
    """

    number: np.ndarray
    boundary_number: np.ndarray
    total: int
    subdomain_count: int
    sends: dict[int, np.ndarray] = field(default_factory=dict)
    receives: dict[int, np.ndarray] = field(default_factory=dict)
    team: Team = ALONE

    @classmethod
    def of(cls, mine: np.ndarray, traces: np.ndarray, boundaries: np.ndarray, count: int,
           team: Team) -> Link:
        """To nobody yet. All ranks ask together.

        mine : (own,) int, ascending, this rank's of ``count`` subdomains
        traces, boundaries : (own,) int, how many trace dofs and boundary dofs each has
        """
        counts = np.zeros((2, count))
        counts[:, mine] = traces, boundaries
        counts = team.sum(counts)[0].astype(int)
        number, boundary_number = (runs((np.cumsum(each) - each)[mine], each[mine])
                                   for each in counts)
        return cls(number, boundary_number, int(counts[0].sum()), count, team=team)


# 2⁶⁴ over the golden ratio (Knuth, TAOCP 3, 6.4)
_MIX, _HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(32)


class Borders:
    """Completes sums at some of a rank's places by what other ranks have there; every rank makes
    one, and calls it as often.

    names : (k, c) numbers that are the same on every rank that has such a place, and differ from
        place to place
    at : (k,) int, where each is among this rank's places
    """

    def __init__(self, names: np.ndarray, at: np.ndarray, team: Team = ALONE):
        self.team, self._at = team, at
        if team.size > 1:
            unique, first, self._place = np.unique(np.asarray(names, float) + 0.0, axis=0,
                                                   return_index=True, return_inverse=True)
            self._first, self._with = at[first], rendezvous(unique, team)

    def __call__(self, sums: np.ndarray) -> np.ndarray:
        """The same array (..., places), completed in place; ranks are added in their order, so that
        all get the same bits.
        """
        if self.team.size == 1:
            return sums
        own, leading = sums[..., self._first], sums.shape[:-1]
        theirs = self.team.exchange({rank: own[..., met] for rank, met in self._with.items()},
                                    {rank: np.empty((*leading, len(met)))
                                     for rank, met in self._with.items()})
        total = np.zeros(own.shape)
        for rank in sorted([self.team.rank, *theirs]):
            if rank == self.team.rank:
                total += own
            else:
                total[..., self._with[rank]] += theirs[rank]
        sums[..., self._at] = total[..., self._place.ravel()]
        return sums


def rendezvous(names: np.ndarray, team: Team) -> dict[int, np.ndarray]:
    """Other ranks that have some of the same names, and (m,) int, ascending, which of this rank's
    these are; all ranks ask together.

    names : (k, c) ascending, none twice
    """
    hashed = np.zeros(len(names), np.uint64)
    for column in names.T:
        hashed = (hashed ^ np.ascontiguousarray(column).view(np.uint64)) * _MIX
        hashed ^= hashed >> _HALF
    home = (hashed % np.uint64(team.size)).astype(int)
    sent = [np.flatnonzero(home == rank) for rank in range(team.size)]
    asked = team.deliver([names[own] for own in sent])
    answers = team.deliver(_met([rows.reshape(-1, names.shape[1]) for rows in asked]))
    found: dict[int, list[np.ndarray]] = {}
    for own, answer in zip(sent, answers):
        row, rank = answer.reshape(-1, 2).T.astype(int)
        for other in np.unique(rank):
            found.setdefault(int(other), []).append(own[row[rank == other]])
    return {rank: np.sort(np.concatenate(rows)) for rank, rows in sorted(found.items())}


def _met(asked: list[np.ndarray]) -> list[np.ndarray]:
    """Per rank that has asked with some names (k, c), (m, 2): the row of a name, and another rank
    that has asked with it.
    """
    rank, row = (np.concatenate(x)
                 for x in zip(*((np.full(len(rows), r), np.arange(len(rows)))
                                for r, rows in enumerate(asked))))
    name = np.unique(np.concatenate(asked), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(name, kind="stable")
    name, rank, row = name[order], rank[order], row[order]
    pairs = [np.empty((0, 3), int)]
    for step in range(1, int(np.bincount(name).max(initial=0))):
        both = np.flatnonzero(name[step:] == name[:-step])
        pairs += [np.column_stack([rank[a], row[a], rank[b]])
                  for a, b in ((both, both + step), (both + step, both))]
    found = np.concatenate(pairs)
    return [found[found[:, 0] == r, 1:].astype(float) for r in range(len(asked))]


pymetis = Late("pymetis")
UNITS = 10_000  # METIS takes integers: the total cost in these units


@dataclass(frozen=True)
class Placement:
    """The ranks' subdomains, as one rank sees it."""

    rank_of: np.ndarray  # (subdomains,) int, the rank of each
    touched: list[bool]  # (interfaces,) bool, whether a side of it is this rank's
    # which codes of the configuration this rank asks: those of its subdomains and of their
    # neighbours
    codes: list[int]

    @classmethod
    def of(cls, scene: Scene, rank_of: np.ndarray, team: Team) -> Placement:
        """As a rank sees it, which has all of the scene or its part."""
        touched = [team.rank in rank_of[list(i.subdomains)] for i in scene.interfaces]
        near = {e for i, here in zip(scene.interfaces, touched) if here for e in i.subdomains}
        near |= set(np.flatnonzero(rank_of == team.rank))
        return cls(rank_of, touched, sorted({scene.subdomains[e].code for e in near}))


def ranks_of(scene: Scene, ranks: int) -> np.ndarray:
    """(subdomains,) int, the rank of each, by predicted cost and neighbourhood.

    Raises InputError: more ranks than subdomains
    """
    count = len(scene.subdomains)
    if ranks > count:
        raise wrong(("subdomains",),
                    f"{ranks} ranks for {count} subdomain{'s' if count > 1 else ''}",
                    "at least one subdomain for every rank",
                    f"mpiexec -n {count} at most, or cut into more subdomains")
    costs = predicted_cost([(~s.fixed).sum() for s in scene.subdomains])
    return owners(costs, [i.subdomains for i in scene.interfaces],
                  [int(i.free.sum()) for i in scene.interfaces], ranks)


def with_workers(codes: Sequence[CodeSettings], team: Team) -> list[CodeSettings]:
    """Settings of codes, where ``workers: auto`` has become the number of cores that this rank may
    call its own.
    """
    share = max(1, int(team.cores()))
    return [code.model_copy(update={"workers": share}) if code.workers == "auto" else code
            for code in codes]


def owners(costs: Sequence[float], pairs: np.ndarray, dofs: Sequence[int],
           ranks: int) -> np.ndarray:
    """(n,) int, the rank of each subdomain; every rank has some.

    Rank 0, which also solves the coarse contact problem and writes, has the part with the fewest
    interface dofs.

    costs : (n,) of each subdomain
    pairs, dofs : (m, 2) int, the subdomains of each interface; (m,) what it has to exchange
    ranks : how many parts, at most n
    """
    costs = np.asarray(costs, float)
    n = len(costs)
    if ranks == 1:
        return np.zeros(n, int)
    one, two = np.asarray(pairs).reshape(-1, 2).T
    graph = sp.coo_array((np.tile(dofs, 2), (np.r_[one, two], np.r_[two, one])),
                         shape=(n, n)).tocsr()
    weights = np.maximum(1, np.rint(UNITS * costs / costs.sum())).astype(int)
    found = pymetis.part_graph(ranks, pymetis.CSRAdjacency(graph.indptr, graph.indices),
                               vweights=weights.tolist(),
                               eweights=graph.data.astype(int).tolist(), recursive=True)
    owner = np.asarray(found.vertex_part, int)
    for rank in range(ranks):  # METIS may leave a part empty where there are few subdomains
        if not (owner == rank).any():
            load = np.bincount(owner, weights=costs, minlength=ranks)
            spare = np.bincount(owner, minlength=ranks) > 1
            richest = np.flatnonzero(owner == np.argmax(np.where(spare, load, -1.0)))
            owner[richest[np.argmin(costs[richest])]] = rank
    lightest = np.argmin(np.bincount(owner[np.r_[one, two]], weights=np.tile(dofs, 2),
                                     minlength=ranks))
    return np.where(owner == lightest, 0, np.where(owner == 0, lightest, owner))
