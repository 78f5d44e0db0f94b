"""Whether laws are as convex as they say: λ ∈ ∂φ(d) asks of any two jumps and their forces that (λ₁
− λ₂)·(d₁ − d₂) ≥ 0.

The guarantee of the energy error hangs on it, and a law of one's own is believed no further than it
is tried: jumps of all sizes from an element down to a millionth of it, in all directions.
"""

from __future__ import annotations

import numpy as np

from orchestrator.errors import Refusal
from orchestrator.laws.points import Points, dot
from orchestrator.method.interface.pairs import Pairs
from orchestrator.parallel.team import Team

SIZES = 10.0 ** -np.arange(7.0)  # of jumps, over the root of a pair's area
ROUNDED = 1e-9  # of the product, what rounding may leave below zero


def check_convex(pairs: Pairs, team: Team) -> None:
    """Try the laws that say they are convex, at all points; raises Refusal: one is not, on all
    ranks.
    """
    if found := next(filter(None, team.all_gather(_not_convex(pairs))), ""):
        raise Refusal("not convex", law=found)


def _not_convex(pairs: Pairs) -> str:
    """The name of the first law that is not as convex as it says; empty where there is none."""
    convex = [i.index for i in pairs.interfaces if i.law.convex and not i.law.perfect]
    for run in pairs.runs:
        chosen = np.isin(run.points.interface, convex)
        if not chosen.any():
            continue
        zero = np.zeros((3, len(chosen)))
        points = run.points.at(int(pairs.numbers[0]), dict.fromkeys(run.law.variables, zero[0]))
        random = np.random.default_rng(0)
        for size in SIZES:
            products, rounding = _products(run.law, points,
                                           random.standard_normal((2, 3, len(chosen))) * size
                                           * np.sqrt(points.area), zero)
            if (products < -ROUNDED * rounding)[chosen].any():
                return run.law.name
    return ""


def _products(law, points: Points, jumps: np.ndarray,
              previous: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) (λ₁ − λ₂)·(d₁ − d₂) of two fields that the law answers to predicted forces, and the size
    of what is multiplied.
    """
    predicted = points.stiffness(jumps)
    answers = [law.force(points, F, previous, derivative=True) for F in predicted]
    forces = np.array([answer.force for answer in answers])
    force, jump = forces[1] - forces[0], points.compliance(np.diff(predicted - forces, axis=0)[0])
    products, sizes = dot(force, jump), np.sqrt(dot(predicted, predicted).sum(axis=0)
                                                * dot(jumps, jumps).sum(axis=0))
    if answers[0].collective is not None:  # pairs of an interface answer together
        group = np.unique(points.interface, return_inverse=True)[1]
        products, sizes = (np.bincount(group, values)[group] for values in (products, sizes))
    return products, sizes
