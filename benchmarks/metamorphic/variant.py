"""Another scene, and how its answer is seen as the first one's."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.metamorphic.answers import Answer
from benchmarks.metamorphic.tools import tools


@dataclass(frozen=True)
class Variant:
    """Another scene, and ``seen``, which gives its answer in the first one's terms.

    Parameters
    ----------
    turn, length, force, factor, names : as of ``Answer.seen``
    order : places of the first scene's entries of boundary among the variant's; tools come after them
    sums : (T, own load steps), what of its load steps adds up to the first scene's
    without : parts that are not compared: models of others, of which joints alone are known
    joint : supports that share nodes may have shared their reaction otherwise; their sum counts
    shuffled : its nodes are in another order, and known by their places
    whole : the first scene is a part of it behind planes of symmetry: energies and reactions are not compared
    rough : soon content, so that what it guarantees counts
    cuts : cut otherwise, so that some cuts may be refused, and operators between meshes that do not match are others
    """

    data: dict[str, Any]
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    length: float = 1.0
    force: float = 1.0
    factor: float = 1.0
    names: dict[str, str] = field(default_factory=dict)
    order: list[int] | None = None
    sums: np.ndarray | None = None
    without: set[str] = field(default_factory=set)
    joint: bool = False
    rough: bool = False
    cuts: bool = False
    shuffled: bool = False
    whole: bool = False

    def seen(self, answer: Answer) -> Answer:
        """Of the variant's, in the axes, units and names of the first scene."""
        seen = answer.seen(self.turn.T, 1 / self.length, 1 / self.force, 1 / self.factor, self.names)
        order = slice(None) if self.order is None else [*self.order, *range(len(seen.reactions) - len(tools(self.data)), len(seen.reactions))]
        if self.whole:
            return replace(seen, reactions=None, moments=None, energy=np.full(len(seen.energy), np.nan), probes={})
        sums = np.eye(len(answer.energy)) if self.sums is None else self.sums
        one = (sums.sum(axis=1) == 1).all() and (np.count_nonzero(sums, axis=1) == 1).all()
        return replace(
            seen, reactions=np.einsum("st,etc->esc", sums, seen.reactions[order]),
            moments=np.einsum("st,etc->esc", sums, seen.moments[order]),
            energy=np.full(len(sums), np.nan) if self.without or not one else sums @ seen.energy,
            probes={} if self.without else {k: np.einsum("st,tc->sc", sums, u) for k, u in seen.probes.items()},
            parts={k: np.einsum("st,tnc->snc", sums, u) for k, u in seen.parts.items() if k not in self.without})
