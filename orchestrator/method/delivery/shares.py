"""Shares of a run's energy error: E² is a sum over bodies and interfaces,

    E² = Σ_bodies ‖v − û‖²_body + 2 Σ_interfaces γ(v, λ̂)

and what of it is a body's own, beside that body's own energy: E is relative to the energy of all bodies together, in which a soft or a
lightly loaded one has next to no say. These are shares of the number that is told, no bounds of single bodies' errors: what one lacks
is strained into its neighbours too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.lawful import Lawful
from orchestrator.method.interface.rows import Segments, times
from orchestrator.method.stopping.bound import ROUNDING, relative


@dataclass(frozen=True)
class Shares:
    """Shares of the error at the load step where it is largest; the largest first.

    step : that load step, from 0
    bodies, interfaces : name → share of E²
    own : body → √ of what is its own, over its own energy norm, the largest of all load steps each; infinite where that is no more. Of
        bodies whose matter is the scene's, and whose error is more than rounding
    """

    step: int
    bodies: dict[str, float]
    interfaces: dict[str, float]
    own: dict[str, float]


def shares(d: Decomposition, lawful: Lawful, energy: np.ndarray) -> Shares:
    """Shares of a run whose energy error is known.

    energy : (T, subdomains) ‖u‖²_K of all ranks, of those whose matter is the scene's
    """
    at, certificate, space = lawful.judged, lawful.certificate, d.space
    of, pairs = Segments(space.boundary), certificate.pairs
    each, gaps = np.zeros((d.steps, len(d.scene.subdomains))), np.zeros((d.steps, len(d.scene.interfaces)))
    found = of.sums(at.delta * (times(certificate.stiffness, at.delta) - 2 * at.change) + at.change * at.x)
    each[:, np.asarray(space.subdomains)[of.subdomains]] = np.maximum(found, 0.0)
    for t, number in enumerate(pairs.numbers):
        gap = pairs.duality_gap(at.pair.forces[t], at.pair.jump[t], at.pair.before[t], number)
        for i, a, b in zip(pairs.interfaces, pairs.bounds[:-1], pairs.bounds[1:]):
            gaps[t, i.index] += 2 * gap[a:b].sum()
    each, gaps = space.team.sum(each, gaps)
    names, body = np.unique([s.body for s in d.scene.subdomains], return_inverse=True)
    each, energy = (np.array([np.bincount(body, row, len(names)) for row in rows]) for rows in (each, energy))
    gaps = np.maximum(gaps, 0.0)
    whole = each.sum(axis=1) + gaps.sum(axis=1)
    step, least = int(whole.argmax()), ROUNDING * np.sqrt(energy.sum(axis=1).max())
    foreign = [d.blackbox.traits(s.code).own_matter for s in d.scene.subdomains] | d.scene.stand_ins
    known = np.bincount(body, foreign, len(names)) == 0
    far, strained = np.sqrt(each.max(axis=0)), np.sqrt(energy.max(axis=0))
    own = {str(names[k]): relative(float(far[k]), float(strained[k])) for k in np.flatnonzero(known & (far > least))}
    total = max(float(whole[step]), np.finfo(float).tiny)
    return Shares(step, _largest(names, each[step] / total), _largest([i.name for i in d.scene.interfaces], gaps[step] / total),
                  dict(sorted(own.items(), key=lambda item: -item[1])))


def _largest(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {str(names[k]): float(values[k]) for k in np.argsort(-values, kind="stable") if values[k] > 0}
