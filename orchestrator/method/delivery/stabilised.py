"""What stabilisation carried at the end: springs that are to be too weak to be noticed.

At a pair the springs carry f̂ − law(F). Relative to the largest force per area that a contact carries, and their work
Σ (f̂ − law(F)) · Δd over the largest strain energy, they tell how far the solution is from that of the laws alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import dot
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated
from orchestrator.scene.conditions.loose import loose_bodies

LIVES = 0.1  # share of the forces on a body, in magnitude, that springs carry, from which it lives by them


@dataclass(frozen=True)
class Stabilised:
    """What the springs carried.

    Parameters
    ----------
    epsilon : largest ε of a pair
    force : largest traction of the springs over the largest that contacts carry
    work : of the springs, all load steps together, over the largest strain energy
    bodies : (T,) names of loose ones that live by them, per load step
    most : name of the loose one whose forces they carry the largest share of
    gave_way : iterations after which they have given way
    """

    epsilon: float
    force: float
    work: float
    bodies: list[list[str]]
    most: str
    gave_way: list[int]


def stabilised(d: Decomposition, iterated: Iterated) -> Stabilised | None:
    """What the springs carried; None where nothing is stabilised."""
    if d.all_perfect or d.local.pairs.stabilisation is None:
        return None
    pairs, local, team = d.local.pairs, iterated.local, d.space.team
    springs, law = local.force - local.lawful, local.lawful
    own, whole = (np.sqrt(dot(x, x)) for x in (springs, law))
    epsilon, largest, carried = team.max(pairs.stabilisation.max(initial=0.0), (own / pairs.points.area).max(initial=0.0),
                                         (whole / pairs.points.area).max(initial=0.0))
    moved = np.diff(local.jump, axis=0, prepend=d.local.before.jump[None])
    ends = np.repeat(np.array([i.subdomains for i in pairs.interfaces], dtype=int).reshape(-1, 2), np.diff(pairs.bounds), axis=0)
    sums = np.zeros((2, d.steps, len(d.scene.subdomains)))
    for magnitudes, result in zip((own, whole), sums):
        for side in ends.T:
            np.add.at(result, (slice(None), side), np.where(pairs.mine, magnitudes, 0.0))
    work, sums = team.sum(float((np.abs(dot(springs, moved)) * pairs.mine).sum()), sums)
    held, pressed = sums
    loose = loose_bodies(d.scene)
    total = held + pressed
    share = np.where(loose | ~loose.any(), held / np.where(total > 0, total, 1.0), 0.0)
    names = [s.body for s in d.scene.subdomains]
    energy = 0.5 * iterated.bound.energy.max(initial=0.0)
    return Stabilised(float(epsilon), _ratio(largest, carried), _ratio(work, energy),
                      [list(dict.fromkeys(name for name, lives in zip(names, step) if lives)) for step in share > LIVES],
                      names[int(share.max(axis=0).argmax())], list(iterated.found.get("giving_way", [])))


def _ratio(part: float, whole: float) -> float:
    """Infinite where springs carry something and contacts nothing."""
    return float(part / whole) if whole > 0 else float("inf") if part > 0 else 0.0
