"""The entry of ``interfaces:`` that governs a pair, and the law that it gives; bodies near each
other and what it asks of a pair of theirs: first step of the search."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from orchestrator.config.boundary import Entry, ROUND
from orchestrator.errors import Problems
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.opposite import (
    BodyFaces, close_bodies, COINCIDE, cosine_of, REACH, TOUCHING)
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.names import matching

BONDED = Entry()


def govern(interface: Interface, entry: Any, factors: Sequence[float], direction: float = 1.0,
           distance: np.ndarray | None = None) -> None:
    """Give an interface the law of an entry, and where it differs between load steps that of each.

    factors : (steps,) what multiplies the entry
    direction, distance : as for ``Law.of``
    """
    law, count = entry.kind, len(interface.global_nodes)
    laws = [law.of(at, count, direction, distance)
            for at in (entry.at_steps(factors) if len(factors) else ())]
    interface.govern(laws or [law.of(entry, count, direction, distance)], bool(laws))
    interface.follows = entry.follows


class Laws:
    """Finds the entry that governs a pair and remembers which entries were of use.

    entries : of the YAML, each with a ``pair`` of patterns, pairs to ``exclude``, and ``law``; the
        last match wins
    names : everything an entry could name, subdomains and volumes
    factors : per entry (steps,) what multiplies it; none: one load step
    asked : whether the user has written them; what is near without an interface is a mistake then
    """

    def __init__(self, entries: list[Any], names: Iterable[str],
                 factors: Sequence[Sequence[float]] = (), asked: bool = True):
        names = list(dict.fromkeys(names))
        self.entries, self.factors, self.names, self.asked = list(entries), factors, names, asked
        self.used = [False] * len(self.entries)
        # with self in it, it would refer to itself, and go only when Python looks for such things
        self.meant = cache(lambda pattern: frozenset(matching(pattern, names)))

    def between(self, first: Iterable[str], second: Iterable[str]) -> int:
        """Index of the governing entry, -1 for none.

        first, second : the names each side goes by (its subdomain's, its volume's)
        """
        for i in self._matching(first, second):
            self.used[i] = True
        return self.foreseen(first, second)

    def foreseen(self, first: Iterable[str], second: Iterable[str]) -> int:
        """The entry for two sides that may turn out to have no interface: no entry counts as
        used.
        """
        hits = self._matching(first, second)
        return hits[-1] if hits else -1

    def apply(self, index: int, interface: Interface, distance: np.ndarray | None = None) -> None:
        """Give an interface the law of an entry; it stays what it is when none matched.

        distance : (n,) of the sides along the normal, where it has been read from the geometry
        """
        if index < 0:
            return
        entry, interface.entry = self.entries[index], index
        # which way the entry's parts are ordered
        direction = 1.0 if self.means(entry.pair[0], interface.called[0]) else -1.0
        govern(interface, entry, self.factors[index] if self.factors else [], direction, distance)

    def __getitem__(self, index: int) -> Any:
        """The entry of an index; of −1 one that bonds what touches."""
        return self.entries[index] if index >= 0 else BONDED

    def slave(self, index: int, first: Iterable[str], second: Iterable[str]) -> int | None:
        """The side, 0 or 1, that an entry makes the slave; None: neither, or both by the same
        word.
        """
        chosen = [self[index].slave is not None and self.means(self[index].slave, side)
                  for side in (first, second)]
        return None if chosen[0] == chosen[1] else chosen.index(True)

    def tolerance(self, index: int) -> float:
        """Distance up to which an entry pairs faces, in units of the element size."""
        entry = self[index]
        if entry.tolerance != "auto":
            return ROUND * entry.tolerance
        return TOUCHING if entry.found else REACH if entry.apart else COINCIDE

    def refuse_within(self, cuts: Iterable[tuple[str, str]], problems: Problems) -> None:
        """Adds a problem for each entry whose law is meant for cuts through a body alone: these are
        perfect.

        cuts : names of the two sides
        """
        cuts = list(dict.fromkeys(cuts))
        for i, entry in enumerate(self.entries):
            hit = None if self.used[i] else next((c for c in cuts
                                                  if i in self._matching(c[:1], c[1:])), None)
            if hit is None:
                continue
            self.used[i] = True
            if not entry.kind.perfect:
                problems.add(("interfaces", i, "between"),
                             f"{entry.law} between {hit[0]} and {hit[1]}, pieces of one body",
                             "names of different bodies: their pieces are joined by perfect "
                             "interfaces",
                             "leave this entry out; a real joint needs two volumes in the mesh")

    def _matching(self, first: Iterable[str], second: Iterable[str]) -> list[int]:
        """Indices of all entries that match, ascending."""
        return [i for i, entry in enumerate(self.entries)
                if entry.tool is None and self._are(entry.pair, first, second)
                and not self._left_out(entry, first, second)]

    def excluded(self, first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether an entry would govern two sides if it did not leave them out, and no other
        does.
        """
        return not self._matching(first, second) and any(self._left_out(entry, first, second)
                                                         for entry in self.entries)

    def _left_out(self, entry: Any, first: Iterable[str], second: Iterable[str]) -> bool:
        return any(self._are(two, first, second) for two in entry.exclude or [])

    def _are(self, two: Sequence[str], first: Iterable[str], second: Iterable[str]) -> bool:
        """Whether two patterns name two sides, in either order."""
        return any(self.means(a, first) and self.means(b, second) for a, b in (two, two[::-1]))

    def means(self, pattern: str, names: Iterable[str]) -> bool:
        """Whether a pattern means one of a side's names."""
        return not self.meant(pattern).isdisjoint(names)


@dataclass(frozen=True)
class Candidate:
    """Two bodies near each other, and what is asked of a pair of theirs.

    pair : the bodies; known : the names that each goes by
    entry : that governs; one that bonds what touches, where none does; index : its place, or −1
    tolerance : up to which distance it pairs faces, in units of the element size
    cosine : bound on that between normals of such faces
    slave : the side, 0 or 1, that it makes the slave; None: neither
    """

    pair: tuple[BodyFaces, BodyFaces]
    known: tuple[tuple[str, str], tuple[str, str]]
    index: int
    entry: Any
    tolerance: float
    cosine: float
    slave: int | None


def candidates(parts: Parts, laws: Laws) -> Iterator[Candidate]:
    """Yield the bodies that may have a pair, by their subdomains."""
    farthest = max((entry.reach or 0.0 for entry in laws.entries), default=0.0)
    for pair in close_bodies(parts.bodies, farthest):
        known = tuple(map(parts.known, pair))
        if not laws.excluded(*known):
            index = laws.foreseen(*known)
            yield Candidate(pair, known, index, laws[index], laws.tolerance(index),
                            cosine_of(laws[index].angle), laws.slave(index, *known))
