"""Which rank owns which subdomain: equal cost, and few interface dofs between ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from orchestrator.timing import predicted_cost
from orchestrator.errors import wrong
from orchestrator.optional import Late
from orchestrator.parallel.team import Team

if TYPE_CHECKING:
    from orchestrator.config.model import BlackBox
    from orchestrator.scene.model import Scene

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


def with_workers(codes: Sequence[BlackBox], team: Team) -> list[BlackBox]:
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
