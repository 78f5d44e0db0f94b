"""Which models are one and the same but for a translation.

Elasticity does not notice a translation: slices of a beam, the cells of a grid or the soles of equal
cuts share stiffness, factorisation and every answer to equal forces.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import fields

import numpy as np

from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.scene.congruence import equal, first_congruent

_COMPARED = ("name", "nodes", "region", "materials", "origin")  # by value or not at all; all else must be identical


def representatives(models: Sequence[Model], traits: Callable[[int], Traits]) -> np.ndarray:
    """(models,) int, the first model that each one is congruent to.

    Numberings must agree: a model whose nodes or tets come in another order counts as different. So do models whose
    code is not known to be indifferent to where they are and what they are called.

    Parameters
    ----------
    traits : of the code of a model, by ``Model.code``, as a black box tells them
    """
    invariant = {code: traits(code).translation_invariant for code in {m.code for m in models}}
    keys = (_key(model) if invariant[model.code] else number for number, model in enumerate(models))
    return first_congruent(keys, [model.nodes for model in models],
                           lambda i, j: _same_matter(models[i], models[j]))


def _key(model: Model) -> Hashable:
    """Numbering, clamped dofs, trace, and whatever else a model may come to hold."""
    rest = (getattr(model, f.name) for f in fields(model) if f.name not in _COMPARED)
    return (model.nodes.shape, *((v.shape, v.tobytes()) if isinstance(v, np.ndarray) else v for v in rest))


def _same_matter(one: Model, other: Model) -> bool:
    return equal(one.materials[one.region], other.materials[other.region])
