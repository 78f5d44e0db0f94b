"""Which models are one and the same but for a translation.

Elasticity does not notice a translation: slices of a beam, the cells of a grid or the soles of equal
cuts share stiffness, factorisation and every answer to equal forces.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import fields

import numpy as np

from orchestrator.blackbox.protocol import Model

# Relative difference of places and moduli that counts as none: the rounding of coordinates a hundred times
# larger than the model is less, what anyone would notice in a result is more.
SAME = 1e-12
_COMPARED = ("name", "nodes", "region", "materials")  # by value or not at all; all else must be identical


def first_alike(keys: Iterable[Hashable], same: Callable[[int, int], bool]) -> np.ndarray:
    """(n,) int, for each thing the first one that equals it: itself if there is none before.

    Parameters
    ----------
    keys : what must be identical
    same : (i, j) → whether things of equal keys are equal
    """
    result, alike = [], {}
    for index, key in enumerate(keys):
        candidates = alike.setdefault(key, [])
        first = next((other for other in candidates if same(index, other)), index)
        if first == index:
            candidates.append(index)
        result.append(first)
    return np.array(result, dtype=int)


def representatives(models: Sequence[Model]) -> np.ndarray:
    """(models,) int, the first model that each one is congruent to.

    Numberings must agree: a model whose nodes or tets come in another order counts as different.
    """
    return first_alike(map(_key, models), lambda i, j: same_shape(models[i].nodes, models[j].nodes)
                       and _same_matter(models[i], models[j]))


def same_shape(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two clouds of points (n, 3) differ by a translation alone, point by point."""
    if one.shape != other.shape:
        return False
    apart = (one - one[:1]) - (other - other[:1])
    return bool(np.abs(apart).max(initial=0.0) <= SAME * np.ptp(one, axis=0).max(initial=0.0))


def _key(model: Model) -> Hashable:
    """Numbering, clamped dofs, trace, and whatever else a model may come to hold."""
    rest = (getattr(model, f.name) for f in fields(model) if f.name not in _COMPARED)
    return (model.nodes.shape, *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in rest))


def _same_matter(one: Model, other: Model) -> bool:
    a, b = one.materials[one.region], other.materials[other.region]
    return bool((np.abs(a - b) <= SAME * np.abs(b)).all())
