"""Sides that slide on each other are paired anew where they are, within every load step until that
moves no point any more.

With the operators B, the normal n and the distance g of the sides at the place w_p where they have
been paired, the jump is

    d = B w + c,    c = (1 − n nᵀ)(d⁰ − B w⁰) + n (g − g₀ − n·B w_p)

w⁰, d⁰ being the traces and the jump that the load step before ended with, and g₀ the distance
before loading. So what has been slid so far is kept, what slides now is the motion of those places
that meet now, and g₀ + n·d is how far the sides are apart. Points whose nodes the other side does
not reach carry nothing and count as open by an element.

Only the operators change: traces, soles and factors stay. The place is that of small displacements:
bodies do not turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairing import make_pairs
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.interface.stabilisation import stabilisation
from orchestrator.method.monitors import Case, Evaluation, Monitor, Verdict
from orchestrator.method.monitors.weakening import weakened
from orchestrator.scene.interfaces.mortar.operators import Mortar
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene


@dataclass
class Following:
    """The interfaces of a rank that follow.

    scene, space, direction, stabilisation : as the pairs are made from
    place : (1, D) traces w_p at which sides are paired now
    before : w⁰ and d⁰; None: nothing was before
    """

    scene: Scene
    space: TraceSpace
    direction: SearchDirection
    stabilisation: np.ndarray
    place: np.ndarray = field(init=False)
    before: tuple[np.ndarray, np.ndarray] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        here = set(self.space.subdomains)
        self.interfaces = [i for i in self.scene.interfaces if i.moving is not None
                           and here.intersection(i.subdomains)]
        self.first = {i.index: i.mortar for i in self.interfaces}
        self.place = np.zeros((1, self.space.size))

    def pair(self, place: np.ndarray) -> Pairs:
        """The pairs where traces (1, D) have brought the sides; scene and numbering have them,
        too.
        """
        w, = self.space.extended(place)
        self.place, mortars = place, {}
        for i in self.interfaces:
            moved = tuple(w[0, side].reshape(-1, 3) for side in self.space.sides[i.index])
            mortars[i.index] = i.moving.paired(i.mortar, moved)
        return self.take(mortars, w)

    def take(self, mortars: dict[int, Mortar], w: np.ndarray) -> Pairs:
        """The pairs with operators that are known, by interface; w (1, D + G)."""
        for i in self.interfaces:
            i.mortar = mortars[i.index]
        self.space.transfer = self.space.transfer.paired(mortars)
        pairs = replace(make_pairs(self.scene, self.space, self.direction.whole,
                                   self.stabilisation), mortars=mortars)
        now = pairs.transfer.jump(w)[0]
        then, jump = (np.zeros_like(now),) * 2 if self.before is None else (
            pairs.transfer.jump(self.before[0])[0], self.before[1])
        for i, at in pairs.each():
            if i.moving is not None:
                pairs.slid[:, at] = self._slid(i, now[:, at], jump[:, at] - then[:, at])
        return pairs

    def _slid(self, i: Interface, now: np.ndarray, slid: np.ndarray) -> np.ndarray:
        """(3, p) c of an interface, from B w_p and d⁰ − B w⁰."""
        n, first = i.mortar.normal.T, self.first[i.index]
        apart = i.mortar.gap - np.where(first.carrying, first.gap,
                                        0.0) - np.einsum("cp,cp->p", n, now)
        return slid + n * (apart - np.einsum("cp,cp->p", n, slid))

    def moved(self, pairs: Pairs, fields: Admissible) -> float:
        """How far any point has moved along the other side since it was paired, in elements; the
        same on all ranks. Points that
        carry nothing have none: they move from the middle of the other side, and towards it as
        well."""
        moved = fields.extended[0][-1:] - self.space.extended(self.place)[0]
        since, farthest = pairs.transfer.jump(moved)[0], 0.0
        for i, at in pairs.each():
            if i.moving is not None:
                n, points = i.mortar.normal.T, i.mortar.points
                along = since[:, at] - n * np.einsum("cp,cp->p", n, since[:, at])
                own, other = (moved[0, side].reshape(-1, 3) for side in self.space.sides[i.index])
                apart = other[np.unique(i.mortar.triangles[:, :3])].mean(axis=0) - own[points]
                along = np.where(i.mortar.carrying, along, apart.T)
                farthest = max(farthest,
                               peak(np.linalg.norm(along, axis=0) / i.moving.surfaces.size[points]))
        return self.space.team.max(farthest)[0]


# A residual of this share of how far points have moved since they were paired, in elements, is
# worth to pair them anew: what
# is solved better than that is solved for the wrong place. The die of ``study contact`` takes 325
# iterations with 0.1, 268 with 1,
# 297 with 3.
WORTH = 1.0

# What Aitken's rule may stretch a way by, and shorten it to.
LONGEST, SHORTEST = 3.0, 0.1


class FollowingMonitor(Monitor):
    """Has the sides paired anew once points have slid farther than the tolerance, in elements, and
    the rest is solved as well.

    Paired where points are they move a little again, mostly to and fro: a place is a share ω of the
    way r from the last one to where the points are then, by Aitken's rule ω' = −ω r·(r' − r) / |r'
    − r|² (Irons & Tuck, Int. J. Numer. Methods Eng. 1, 1969). The forces of points go with them, to
    the nodes that they meet there.
    """

    name, remembered = "following", ("trace/place", "trace/way", "share")

    def __init__(self, case: Case):
        self.case, self.following = case, case.given["following"]
        self.place = self.following.place
        # the last r, zero before the first, and ω
        self.way, self.share = np.zeros_like(self.place), 1.0

    @classmethod
    def of(cls, case: Case) -> FollowingMonitor | None:
        d = case.problem
        if not any(i.follows for i in d.scene.interfaces):
            return None
        if "following" not in case.given:
            springs = stabilisation(d.scene, case.method, d.made.sole_scale)
            case.given["following"] = Following(d.scene, d.space, d.stage.direction, springs)
        return cls(case)

    def judge(self, now: Evaluation) -> Verdict:
        moved = self.following.moved(now.problem.local.pairs, now.best)
        if moved > self.case.value and now.verdict.measure <= max(
            self.case.value, WORTH * min(moved, 1.0)):
            return Verdict(False, changes=(self.name,), anew=True)
        return Verdict()

    def change(self, now: Evaluation) -> Decomposition:
        way = now.fields.w - self.place
        turn = way - self.way
        along, size = self.case.problem.space.team.sum(float((self.way * turn).sum()),
                                                       float((turn * turn).sum()))
        self.share = float(np.clip(-self.share * along / size, SHORTEST,
                                   LONGEST)) if along and size > 0 else 1.0
        self.way, self.place = way, self.place + self.share * way
        problem, force = self.paired(now.problem), now.local.force
        there, here = (d.local.pairs.transfer.opposed(force)[:, : d.space.size]
                       for d in (problem, now.problem))
        now.fields = replace(now.fields, s=now.fields.s + there - here)
        return problem

    def paired(self, d: Decomposition) -> Decomposition:
        """Pair sides anew at the place where they are."""
        pairs = self.following.pair(self.place).at_steps_of(d.local.pairs)
        if (springs := d.local.pairs.springs) != 1:
            pairs = pairs.weakened(springs)
        return d.meeting(pairs.lawful, d.coarse and d.coarse.paired(pairs))

    def restore(self, state: Mapping[str, Any], problem: Decomposition) -> Decomposition:
        super().restore(state, problem)
        return problem if np.array_equal(self.place, self.following.place) else self.paired(problem)

    def passed(self, d: Decomposition, ended: Any, left: History) -> tuple[Decomposition, History]:
        d = paired_as(d, ended.problem)
        pairs, (w, f) = d.local.pairs, ended.fields.extended
        jump = pairs.traces(w[-1:], f[-1:]).jump[-1]
        self.following.before = w[-1:], jump
        # points that carry nothing keep their jumps
        return d, History(np.where(pairs.free, left.jump, jump), left.own)


def paired_as(d: Decomposition, other: Decomposition) -> Decomposition:
    """Take, for all load steps, the pairs that another decomposition has for some; the springs of
    stabilisation stay its own.
    """
    if (springs := other.local.pairs.springs) != 1:
        other = weakened(other, 1 / springs)
    coarse = copy(other.coarse)
    if coarse is not None:
        coarse.radius, coarse.anew = None, d.coarse.anew
    return d.meeting(other.local.pairs.at_steps_of(d.local.pairs), coarse)
