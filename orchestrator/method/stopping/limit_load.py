"""Which load steps of a scene no forces balance that its laws allow, and the motion of bodies that
shows it.

Bodies are what perfect interfaces join; they move as rigid ones, as far as their supports let them.
What every interface between them may carry its law says (``Law.carries``): the second-order cone
problem of ``cone_problem`` decides. It knows nothing of the iterations, but for two things: where
sides that slide are paired anew, and what damage the load steps before have left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.errors import SHOWN, some
from orchestrator.laws.points import Carries, norm
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import peak, ratio
from orchestrator.method.linear.loading import partway
from orchestrator.method.local_stage import LawStage
from orchestrator.method.stopping.bodies import JoinedBodies, RIGID
from orchestrator.method.stopping.carrying_points import Reach
from orchestrator.method.stopping.cone_problem import failing, Motion, unresisted
from orchestrator.scene.conditions.rigid import DISPLACEMENT
from orchestrator.scene.interface import ends_of

State = tuple[np.ndarray, np.ndarray] | None  # forces and jumps (3, P)
ROUNDING = 1e-12  # of all loads on a body, in magnitude, what is left of their sum
# of what is prescribed, what may strain a body beside its rigid motion: coordinates have six digits
RIGIDLY = 1e-6
TAKES_PART = 1e-2  # of the farthest body's way, from which a body is named


@dataclass(frozen=True)
class BodyMotion:
    """How a body moves, relative to the farthest.

    body : its name
    shift : (3,) of its centre
    turn : (3,) rotation times half its size
    """

    body: str
    shift: list[float]
    turn: list[float]

    def __str__(self) -> str:
        turns = np.linalg.norm(self.turn) > np.linalg.norm(self.shift)
        along = np.array(self.turn if turns else self.shift)
        along = np.round(along / np.linalg.norm(along), 2) + 0.0
        return (
            f"{self.body} {'turns about' if turns else 'moves along'} "
            f"({', '.join(f'{x:.2g}' for x in along)})")


@dataclass(frozen=True)
class LimitLoad:
    """Motions that show that the loads of a load step cannot be carried.

    load_step : from 1
    motions : of the bodies, the farthest first, in which loads do more work than anything resists
    lacking : force that balance lacks at least, over the largest load on a body
    factor : share, 0 to 1, of what this load step adds that is carried; None where the loads of the
        load step before are not carried either, and where that is not known
    pressures : friction was taken at the pressures of the run's last state; else at any
    prescribed : no load, but what supports prescribe drives the bodies, and no force resists it: it
        carries nothing
    """

    load_step: int
    motions: list[BodyMotion]
    lacking: float
    factor: float | None
    pressures: bool
    prescribed: bool = False

    def __str__(self) -> str:
        how = (
            "at the pressures that are there, friction and contact resist" if self.pressures
            else "contact and friction can resist")
        moves = "; ".join(map(str, self.motions[:SHOWN]))
        rest = [motion.body for motion in self.motions[SHOWN:]]
        if self.prescribed:
            return (
                f"load step {self.load_step}: {moves}{f'; so do {some(rest)}' if rest else ''}: "
                "they make way for what supports prescribe, and whatever the pressures, contact "
                "and friction resist no part of it")
        return (
            f"load step {self.load_step}: {moves}{f'; so do {some(rest)}' if rest else ''}: the "
            f"loads do more work in that motion than {how}{self._how_far}")

    @property
    def _how_far(self) -> str:
        if self.factor is None:
            return ""
        if self.factor < 1e-3:
            return "; no part of what this load step adds is carried, however small"
        return f"; {self.factor:.1%} of what this load step adds is carried"


class LimitLoads:
    """Looks for limit loads in the load steps of a case.

    loads : (scene's steps, bodies, 6) in the motions that supports leave, forces, and moments over
        the body's size
    noise : (bodies,) what rounding leaves of them
    """

    def __init__(self, d: Decomposition):
        self.team, self.bodies = d.space.team, JoinedBodies(d, lambda i: i.law.perfect)
        self.loads = np.zeros((d.scene.steps, self.bodies.count, RIGID))
        self.noise = np.zeros(self.bodies.count)
        boundary = {}
        for e, (s, b, rows) in enumerate(zip(d.own, self.bodies.own, self.bodies.motions)):
            loose, load = self.bodies.loose[b], np.where(s.fixed, 0.0,
                                                         s.loads).reshape(d.scene.steps, -1)
            moved = self.bodies.of(b, d.scene.mesh.nodes[s.nodes]).reshape(-1, RIGID) @ loose
            self.loads[:, b] += load @ moved
            self.noise[b] += ROUNDING * float(np.abs(load).sum(axis=1).max())
            boundary[e] = rows @ loose
        self.loads, self.noise = self.team.sum(self.loads, self.noise)
        self.everywhere = d.space.everywhere(d.space.side_by_side(boundary, RIGID))

    @property
    def loose(self) -> bool:
        """Whether any body can move."""
        return bool(self.bodies.loose.any())

    def reach(self, local: LawStage, number: float, state: State = None) -> Reach:
        """Return what this rank's points may carry at a load step of the scene; parameters as of
        ``__call__``.
        """
        pairs = local.pairs
        first, second = (side(self.everywhere).transpose(2, 1, 0)
                         for side in (pairs.transfer.first, pairs.transfer.second))
        J = np.concatenate([-first, second], axis=2)
        ends = self.bodies.body[ends_of(pairs.interfaces)]
        counts = np.diff(pairs.bounds)
        ends, group = np.repeat(ends, counts,
                                axis=0), np.repeat([i.index for i in pairs.interfaces],
                                                   counts).astype(int)
        parts = [Reach.of(J[:0], ends[:0], group[:0], np.zeros((3, 0)), Carries.anything(0))]
        for at, carries in pairs.carries(local.before, number):
            parts.append(Reach.of(J[at], ends[at], group[at], pairs.points.normal[:, at], carries))
        reach = Reach.joined(parts).some(pairs.mine)
        if state is None:
            return reach
        push, opened = -pairs.points.along(state[0])[pairs.mine], pairs.points.along(state[1])[
            pairs.mine]
        way = 2 * DISPLACEMENT * self.bodies.size[reach.ends].max(axis=1)
        return reach.at_pressures(np.maximum(push, 0.0), reach.apart + opened, way)

    def __call__(self, local: LawStage, number: float, state: State = None) -> LimitLoad | None:
        """The limit load of a load step ``number`` of the scene, from 0, or a part of one; None
        where there are forces that balance all.

        local : pairs that are not perfect, as they meet now, and what the load steps before have
            left
        state : forces and jumps (3, P) whose friction and whose gaps count, see
            ``Reach.at_pressures``; None: any pressure, and no gap
        """
        loads, whole = self._at(number), math.ceil(number)
        earlier = self._at(whole - 1) if whole else np.zeros_like(loads)
        found = self._of_all(self.reach(local, number, state),
                             lambda reach: failing(reach, loads, earlier, self.noise))
        return found and self._told(found, number, state is not None)

    def making_way(self, d: Decomposition, t: int) -> LimitLoad | None:
        """Bodies that make way for what supports prescribe, because no force of any pressures
        resists it; None where some force does,
        where loads act as well, or where supports strain their bodies.

        d : of these load steps, the t-th of which is meant
        """
        local = d.local
        number, moved = local.pairs.numbers[t], d.stage.trace(d.loading.carried)[t: t + 1]
        strained, most, acts = self.team.max(d.loading.strained[t], peak(moved),
                                             peak(self._at(number)))
        if acts or strained > RIGIDLY * most:
            return None
        given = local.pairs.transfer.jump(d.space.extended(moved)[0])[0].T[local.pairs.mine] / (
            most or 1.0)
        reach = self.reach(local, number)
        reach = replace(reach, J=np.concatenate([reach.J, given[:, :, None]], axis=2))
        found = self._of_all(reach, lambda reach: unresisted(reach, self.bodies.count))
        return None if found is None else replace(self._told(Motion(found, 0.0), number, False),
                                                  prescribed=True)

    def _of_all(self, reach: Reach, judge: Callable[[Reach], Any]) -> Any:
        """Return what rank 0 finds of all ranks' points, on all of them."""
        parts = self.team.gather(reach.extremes())
        return self.team.share(parts and judge(Reach.joined(parts)))

    def _at(self, number: float) -> np.ndarray:
        """(bodies, 6) loads at a load step, or a part of one."""
        step = math.ceil(number)
        return partway(self.loads, step, 1 - (step - number))

    def missing(self, local: LawStage, number: float, force: np.ndarray) -> np.ndarray:
        """(bodies,) how far forces (3, P) of the laws are from balance at a load step, over all
        forces on the body, in magnitude.
        """
        reach, force = self.reach(local, number), force[:, local.pairs.mine]
        left, carried = np.zeros((self.bodies.count, RIGID)), np.zeros(self.bodies.count)
        for k, columns in enumerate((slice(0, RIGID), slice(RIGID, 2 * RIGID))):
            np.add.at(left, reach.ends[:, k],
                      np.einsum("pcj,cp->pj", reach.J[:, :, columns], force))
            np.add.at(carried, reach.ends[:, k], norm(force))
        left, carried = self.team.sum(left, carried)
        lost, most = (np.linalg.norm(x, axis=1)
                      for x in (self._at(number) - left, self._at(number)))
        return ratio(lost, np.maximum(most, carried), lost > self.noise)

    def let_go(self, d: Decomposition, force: np.ndarray, share: float) -> bool:
        """Return whether a body that can move is loaded and pressed at one load step, by forces
        (T, 3, P), and at the next one loaded and pressed by less than a share of these."""
        f, size = d.local.pairs.transfer.opposed(force), np.zeros((len(force), self.bodies.count))
        for body, part in zip(self.bodies.own, d.space.parts):
            size[:, body] += np.linalg.norm(f[:, part], axis=1)
        loads = np.linalg.norm([self._at(number) for number in d.local.pairs.numbers], axis=2)
        size, = self.team.sum(size)
        gone = (size[1:] < share * size[:-1]) & (loads[1:] < share * loads[:-1])
        return bool(gone[:, self.bodies.loose.any(axis=(1, 2))].any())

    def _told(self, found: Motion, number: float, pressures: bool) -> LimitLoad:
        """In words and numbers."""
        way = np.linalg.norm(found.y, axis=1)
        chosen = [b for b in np.argsort(-way, kind="stable") if way[b] > TAKES_PART]
        motions = [BodyMotion(self.bodies.names[b],
                              (m := self.bodies.loose[b] @ found.y[b])[:3].tolist(), m[3:].tolist())
                   for b in chosen]
        whole = math.ceil(number)
        factor = None if np.isnan(found.factor) else found.factor * (1 - (whole - number))
        return LimitLoad(whole + 1, motions, found.lacking, factor, pressures)
