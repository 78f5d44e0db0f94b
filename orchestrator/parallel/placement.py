"""Which rank owns which subdomain: equal cost, and few interface dofs between ranks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pymetis
import scipy.sparse as sp

UNITS = 10_000  # METIS takes integers: the total cost in these units


def owners(costs: Sequence[float], pairs: np.ndarray, dofs: Sequence[int], ranks: int) -> np.ndarray:
    """Partition the graph of the subdomains.

    Parameters
    ----------
    costs : (n,) of each subdomain
    pairs : (m, 2) int, the subdomains of each interface
    dofs : (m,) int, what each interface has to exchange
    ranks : how many parts, at most n

    Returns
    -------
    (n,) int, the rank of each subdomain; every rank has some. Rank 0, which also solves the coarse problems and
    writes, has the part with the fewest interface dofs
    """
    costs = np.asarray(costs, float)
    n = len(costs)
    if ranks == 1:
        return np.zeros(n, dtype=int)
    one, two = np.asarray(pairs).reshape(-1, 2).T
    graph = sp.coo_array((np.tile(dofs, 2), (np.r_[one, two], np.r_[two, one])), shape=(n, n)).tocsr()
    weights = np.maximum(1, np.rint(UNITS * costs / costs.sum())).astype(int)
    found = pymetis.part_graph(ranks, pymetis.CSRAdjacency(graph.indptr, graph.indices), vweights=weights.tolist(),
                               eweights=graph.data.astype(int).tolist(), recursive=True)
    owner = np.asarray(found.vertex_part, dtype=int)
    for rank in range(ranks):  # METIS may leave a part empty where there are few subdomains
        if not (owner == rank).any():
            load = np.bincount(owner, weights=costs, minlength=ranks)
            spare = np.bincount(owner, minlength=ranks) > 1
            richest = np.flatnonzero(owner == np.argmax(np.where(spare, load, -1.0)))
            owner[richest[np.argmin(costs[richest])]] = rank
    lightest = np.argmin(np.bincount(owner[np.r_[one, two]], weights=np.tile(dofs, 2), minlength=ranks))
    return np.where(owner == lightest, 0, np.where(owner == 0, lightest, owner))
