"""Stiffness of many small models: congruent ones once, the others together in few requests.

Of the soles of 100 grains, 467 interfaces with 230,000 tets, FreeFEM has the stiffness in 4.1 s this way, in 9.1 s one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import fields

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox, Model, Origin, Traits
from orchestrator.timing import Savings
from orchestrator.scene.congruence import equal, first_congruent

_COMPARED = ("name", "nodes", "region", "materials", "origin")  # by value or not at all; all else must be identical
# Tets per request. Of the soles of 100 grains FreeFEM assembles requests of this size in two thirds of the time it takes for
# two large ones; ten times smaller ones gain little more and cost messages.
LARGEST = 4000
# Nodes of one packet at the same place. FreeFEM's search tree gives up on more than eight; half of them, as
# nodes that differ by rounding may be taken for two places.
CROWD = 4
GRID = 1 << 21  # steps along each axis, by which places are told apart


def representatives(models: Sequence[Model], traits: Callable[[int], Traits]) -> np.ndarray:
    """(models,) int, the first model that each one equals but for a translation, which elasticity does not notice.

    Numberings must agree: a model whose nodes or tets come in another order counts as different. So do models whose
    code is not known to be indifferent to where they are and what they are called.

    traits : of the code of a model, by ``Model.code``, as a black box tells them
    """
    invariant = {code: traits(code).translation_invariant for code in {m.code for m in models}}
    keys = (_key(model) if invariant[model.code] else number for number, model in enumerate(models))
    return first_congruent(keys, [model.nodes for model in models],
                           lambda i, j: equal(*(m.materials[m.region] for m in (models[i], models[j]))))


def _key(model: Model) -> Hashable:
    """Numbering, clamped dofs, trace, and whatever else a model may come to hold."""
    rest = (getattr(model, f.name) for f in fields(model) if f.name not in _COMPARED)
    return (model.nodes.shape, *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in rest))


def assembled(models: Sequence[Model], blackbox: BlackBox, workers: int, share: bool, savings: Savings) -> list[sp.csr_array]:
    """(3n, 3n) stiffness of every model; where they ``share``, congruent ones get the very same. Raises BlackBoxError from the code.

    workers : the models are joined in about this many requests, or in more so that none is large
    """
    if not models:
        return []
    first = representatives(models, blackbox.traits) if share else np.arange(len(models))
    kinds = np.unique(first)
    savings.add("congruent", "small stiffness matrices", len(models) - len(kinds))
    packets = _packets([models[k] for k in kinds], max(workers, sum(len(models[k].cells) for k in kinds) // LARGEST))
    found: dict[int, sp.csr_array] = {}
    for whole, members in zip(blackbox.stiffness([joined([models[kinds[m]] for m in members]) for members in packets]), packets):
        ends = np.cumsum([0] + [3 * len(models[kinds[m]].nodes) for m in members]).tolist()
        found |= {int(kinds[m]): sp.csr_array(whole[a:b, a:b]) for m, a, b in zip(members, ends[:-1], ends[1:])}
    return [found[int(k)] for k in first]


def joined(models: Sequence[Model]) -> Model:
    """Models of one code side by side. Each stays where it is, so that its stiffness is the same bit for bit whatever it is joined with,
    on any number of ranks, and for a sole also the same as within an extended subdomain: s − k w would show the rounding of another
    place."""
    nodes, regions = (np.cumsum([0] + [len(getattr(m, name)) for m in models]) for name in ("nodes", "materials"))
    return Model(f"{models[0].name} … {models[-1].name}", np.vstack([m.nodes for m in models]),
                 np.vstack([m.cells + s for m, s in zip(models, nodes)]), np.concatenate([m.region + s for m, s in zip(models, regions)]),
                 np.vstack([m.materials for m in models]), np.vstack([m.fixed for m in models]), np.empty(0, int), models[0].code,
                 _origin(models))


def _origin(models: Sequence[Model]) -> Origin | None:
    """That of models side by side."""
    known = [model.origin for model in models if model.origin is not None]
    if not known:
        return None
    nodes, cells = [], []
    for model in models:
        for numbers, name in ((nodes, "nodes"), (cells, "cells")):
            own = np.empty(0, int) if model.origin is None else getattr(model.origin, name)
            numbers += [own, np.full(len(getattr(model, name)) - len(own), -1)]
    return Origin(np.concatenate(nodes), np.concatenate(cells), known[0].volume, known[0].volumes)


def _packets(models: Sequence[Model], count: int) -> list[list[int]]:
    """Models of one code to be joined, about ``count`` lists of about equal size for each, in none of which nodes crowd."""
    codes, points, packets = np.array([m.code for m in models]), _points([m.nodes for m in models]), []
    beyond = max(own.max() for own in points) + 1
    for code in np.unique(codes):
        own = np.flatnonzero(codes == code).tolist()
        enough = sum(len(models[i].cells) for i in own) / count
        unfilled: list[tuple[list[int], np.ndarray]] = []  # with how many of their nodes are at each point
        for i in own:
            packet = next((p for p in unfilled if p[1][points[i]].max() < CROWD), None)
            if packet is None:
                unfilled.append(packet := ([], np.zeros(beyond, np.int8)))
                packets.append(packet[0])
            packet[0].append(i)
            packet[1][points[i]] += 1
            if sum(len(models[m].cells) for m in packet[0]) >= enough:
                unfilled = [p for p in unfilled if p is not packet]
    return packets


def _points(clouds: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per cloud (n, 3) of nodes, the number (n,) of the point each is at: the same for nodes that coincide."""
    nodes = np.vstack(clouds)
    lowest, extent = nodes.min(axis=0), np.ptp(nodes, axis=0).max()
    cells = np.round((nodes - lowest) * ((GRID - 1) / extent)).astype(np.int64)
    points = np.unique(cells @ np.array([GRID**2, GRID, 1]), return_inverse=True)[1]
    return np.split(points, np.cumsum([len(c) for c in clouds])[:-1])
