"""First step of the search for pairs: bodies near each other, and what the entry that governs
them asks of a pair."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.opposite import BodyFaces, close_bodies, cosine_of
from orchestrator.scene.interfaces.parts import Parts


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
