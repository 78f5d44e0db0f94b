"""Stiffness of many small models: congruent ones once, the others together in few requests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models.congruence import representatives
from orchestrator.blackbox.models.joined import joined
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.savings import Savings

# Tets per request. Of the soles of 100 grains, 230,000 tets, FreeFEM assembles requests of this size in two thirds
# of the time it takes for two large ones; ten times smaller ones gain little more and cost messages.
LARGEST = 4000


def assembled(models: Sequence[Model], blackbox: BlackBox, workers: int, share: bool,
              savings: Savings) -> list[sp.csr_array]:
    """Stiffness (3n, 3n) of every model; congruent ones get the very same matrix.

    Parameters
    ----------
    workers : the models are joined in about this many requests, or in more so that none is large
    share : whether to look for congruent models

    Raises
    ------
    BlackBoxError : from the code
    """
    if not models:
        return []
    first = representatives(models, blackbox.traits) if share else np.arange(len(models))
    kinds = np.unique(first)
    savings.add("congruent", "small stiffness matrices", len(models) - len(kinds))
    tets = sum(len(models[k].cells) for k in kinds)
    packets = joined([models[k] for k in kinds], max(workers, tets // LARGEST))
    found: dict[int, sp.csr_array] = {}
    for stiffness, (_, members) in zip(blackbox.stiffness([m for m, _ in packets]), packets):
        ends = np.cumsum([0] + [3 * len(models[kinds[m]].nodes) for m in members])
        found |= {int(kinds[m]): _block(stiffness, a, b) for m, a, b in zip(members, ends[:-1], ends[1:])}
    return [found[int(k)] for k in first]


def _block(stiffness: sp.csr_array, first: int, last: int) -> sp.csr_array:
    """Rows and columns first … last − 1 of a matrix that couples them with no others."""
    pointers = stiffness.indptr[first : last + 1]
    inside = slice(pointers[0], pointers[-1])
    return sp.csr_array((stiffness.data[inside], stiffness.indices[inside] - first, pointers - pointers[0]),
                        shape=(last - first,) * 2)
