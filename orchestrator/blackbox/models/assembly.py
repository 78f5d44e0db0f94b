"""Stiffness of many small models: congruent ones once, the others together in few requests."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models.congruence import representatives
from orchestrator.blackbox.models.joined import joined
from orchestrator.blackbox.protocol import BlackBox, Model
from orchestrator.savings import Savings

# Tets per request. Of the soles of 100 grains, 230,000 tets, FreeFEM assembles requests of this size in two thirds
# of the time it takes for two large ones; ten times smaller ones gain little more and cost messages.
LARGEST = 4000


@dataclass(eq=False)
class Assembled:
    """A model's stiffness, within that of models that are not coupled to it.

    Parameters
    ----------
    whole : stiffness of all of them
    first, last : its dofs are first … last − 1
    """

    whole: sp.csr_array
    first: int
    last: int

    @cached_property
    def matrix(self) -> sp.csr_array:
        """(3n, 3n) by itself."""
        pointers = self.whole.indptr[self.first : self.last + 1]
        inside = slice(pointers[0], pointers[-1])
        return sp.csr_array((self.whole.data[inside], self.whole.indices[inside] - self.first, pointers - pointers[0]),
                            shape=(self.last - self.first,) * 2)


@dataclass(frozen=True, eq=False)
class Block:
    """A small sparse matrix (n, n) by rows: for thousands of them SciPy's own would take longer to be made than to be used."""

    data: np.ndarray
    indices: np.ndarray
    indptr: np.ndarray

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return len(self.data)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, n)."""
        return (len(self.indptr) - 1,) * 2


def assembled(models: Sequence[Model], blackbox: BlackBox, workers: int, share: bool,
              savings: Savings) -> list[Assembled]:
    """Stiffness of every model; congruent ones get the very same.

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
    found: dict[int, Assembled] = {}
    for stiffness, (_, members) in zip(blackbox.stiffness([m for m, _ in packets]), packets):
        ends = np.cumsum([0] + [3 * len(models[kinds[m]].nodes) for m in members]).tolist()
        found |= {int(kinds[m]): Assembled(stiffness, a, b) for m, a, b in zip(members, ends[:-1], ends[1:])}
    return [found[int(k)] for k in first]


def cut(found: Sequence[Assembled], chosen: Sequence[np.ndarray]) -> list[Block]:
    """Rows and columns (n,) of each stiffness; those that lie in one matrix are taken from it together."""
    groups: dict[tuple[int, int], list[int]] = {}
    before: Counter[int] = Counter()
    for place, one in enumerate(found):  # what is asked for twice would meet itself
        groups.setdefault((id(one.whole), before[id(one)]), []).append(place)
        before[id(one)] += 1
    blocks: list[Block | None] = [None] * len(found)
    for places in groups.values():
        dofs = np.concatenate([found[place].first + chosen[place] for place in places])
        taken = sp.csr_array(found[places[0]].whole[dofs][:, dofs])
        ends, first = taken.indptr, 0
        for place in places:
            last = first + len(chosen[place])
            entries = slice(ends[first], ends[last])
            blocks[place] = Block(taken.data[entries], taken.indices[entries] - first, ends[first : last + 1] - ends[first])
            first = last
    return blocks
