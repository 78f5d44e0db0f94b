"""How far the places of loose bodies are determined, as it is told: beside the largest displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.lengths import LengthScale
from orchestrator.parallel.team import Team


@dataclass(frozen=True)
class OpenPlaces:
    """Over the largest displacement of all bodies and load steps.

    Parameters
    ----------
    open : of the body whose place is determined least
    bodies : name of each that supports and joints leave loose → the same of it, at its worst load step, the largest first
    """

    open: float
    bodies: dict[str, float]


def open_places(iterated: Iterated, lengths: LengthScale, parts: Sequence[np.ndarray | None], team: Team) -> OpenPlaces | None:
    """What is told of them; None where nothing is stabilised, or where nothing can be said.

    Parameters
    ----------
    parts : displacements (T, n_E, 3) of this rank's subdomains; None: not ours
    """
    found = iterated.found.get("places", [])
    if sum(places.shape[1] for places in found) < len(iterated.fields.s):
        return None
    largest, = team.max(max((np.abs(u).max(initial=0.0) for u in parts if u is not None), default=0.0))
    each = np.concatenate(found, axis=1).max(axis=1) / (largest or 1.0)
    bodies: dict[str, float] = {}
    for b in np.argsort(-each, kind="stable"):
        if each[b] > 0:
            bodies.setdefault(lengths.names[b], float(each[b]))
    return OpenPlaces(float(each.max(initial=0.0)), bodies)
