"""Which law holds on an interface: the entries of ``interfaces:`` matched against names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from orchestrator.config.boundary import Entry
from orchestrator.errors import Problems
from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.opposite import COINCIDE, OPPOSITE, REACH, TOUCHING
from orchestrator.scene.model import Interface
from orchestrator.scene.names import matching

BONDED = Entry()


def govern(interface: Interface, entry: Any, factors: Sequence[float], direction: float = 1.0, distance: np.ndarray | None = None) -> None:
    """Give an interface the law of an entry, and where it differs between load steps that of each.

    factors : (steps,) what multiplies the entry
    direction, distance : as for ``Law.of``
    """
    law, count = LAWS[entry.law], len(interface.global_nodes)
    interface.law_at_steps = [law.of(at, count, direction, distance) for at in entry.at_steps(factors)] if len(factors) else []
    interface.law = max(interface.law_at_steps, key=lambda one: one.imposed) if interface.law_at_steps else \
        law.of(entry, count, direction, distance)


class Laws:
    """Finds the entry that governs a pair and remembers which entries were of use.

    entries : of the YAML, each with a ``pair`` of patterns, pairs to ``exclude``, and ``law``; the last match wins
    names : everything an entry could name, subdomains and volumes
    factors : per entry (steps,) what multiplies it; none: one load step
    """

    def __init__(self, entries: list[Any], names: Iterable[str], factors: Sequence[Sequence[float]] = ()):
        self.entries, self.factors, self.names = list(entries), factors, list(dict.fromkeys(names))
        self.used = [False] * len(self.entries)
        self.meant = lru_cache(maxsize=None)(lambda pattern: frozenset(matching(pattern, self.names)))

    def between(self, first: Iterable[str], second: Iterable[str]) -> int:
        """Index of the governing entry, -1 for none.

        first, second : the names each side goes by (its subdomain's, its volume's)
        """
        hits = self._matching(first, second)
        for i in hits:
            self.used[i] = True
        return hits[-1] if hits else -1

    def foreseen(self, first: Iterable[str], second: Iterable[str]) -> int:
        """The same for two sides that may turn out to have no interface: no entry counts as used."""
        hits = self._matching(first, second)
        return hits[-1] if hits else -1

    def apply(self, index: int, interface: Interface, first: Iterable[str], distance: np.ndarray | None = None) -> None:
        """Give an interface the law of an entry; it stays what it is when none matched.

        first : the names its first side goes by: they tell which way the entry's parts are ordered
        distance : (n,) of the sides along the normal, where it has been read from the geometry
        """
        if index < 0:
            return
        entry, interface.entry = self.entries[index], index
        direction = 1.0 if self.means(entry.pair[0], first) else -1.0
        govern(interface, entry, self.factors[index] if self.factors else [], direction, distance)

    def __getitem__(self, index: int) -> Any:
        """The entry of an index; of −1 one that bonds what touches."""
        return self.entries[index] if index >= 0 else BONDED

    def slave(self, index: int, first: Iterable[str], second: Iterable[str]) -> int | None:
        """Which side, 0 or 1, an entry has for the slave; None: neither, or both by the same word."""
        chosen = [self[index].slave is not None and self.means(self[index].slave, side) for side in (first, second)]
        return None if chosen[0] == chosen[1] else chosen.index(True)

    def tolerance(self, index: int) -> float:
        """How far apart faces may be that an entry pairs, in units of the element size."""
        entry = self[index]
        if entry.tolerance != "auto":
            return entry.tolerance
        return TOUCHING if entry.found else REACH if entry.apart else COINCIDE

    def opposite(self, index: int) -> float:
        """What the cosine between the normals of faces has to be below that an entry pairs."""
        angle = self[index].angle
        return OPPOSITE if angle is None else -float(np.cos(np.deg2rad(angle)))

    def refuse_within(self, cuts: Iterable[tuple[str, str]], problems: Problems) -> None:
        """Adds a problem for each entry whose law is meant for cuts through a body alone: these are perfect.

        cuts : names of the two sides
        """
        cuts = list(dict.fromkeys(cuts))
        for i, entry in enumerate(self.entries):
            hit = None if self.used[i] else next((c for c in cuts if i in self._matching(c[:1], c[1:])), None)
            if hit is None:
                continue
            self.used[i] = True
            if not LAWS[entry.law].perfect:
                problems.add(("interfaces", i, "between"), f"{entry.law} between {hit[0]} and {hit[1]}, pieces of one body",
                             "names of different bodies: their pieces are joined by perfect interfaces",
                             "leave this entry out; a real joint needs two volumes in the mesh")

    def _matching(self, first: Iterable[str], second: Iterable[str]) -> list[int]:
        """Indices of all entries that match, ascending."""
        return [i for i, entry in enumerate(self.entries)
                if self._are(entry.pair, first, second) and not self._left_out(entry, first, second)]

    def excluded(self, first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether an entry would govern two sides if it did not leave them out, and no other does."""
        return not self._matching(first, second) and any(self._left_out(entry, first, second) for entry in self.entries)

    def _left_out(self, entry: Any, first: Iterable[str], second: Iterable[str]) -> bool:
        return any(self._are(two, first, second) for two in entry.exclude or [])

    def _are(self, two: Sequence[str], first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether two patterns name two sides, in either order."""
        a, b = two
        return (self.means(a, first) and self.means(b, second)) or (self.means(b, first) and self.means(a, second))

    def means(self, pattern: str, names: Iterable[str]) -> bool:
        """Whether a pattern means one of a side's names."""
        return not self.meant(pattern).isdisjoint(names)
