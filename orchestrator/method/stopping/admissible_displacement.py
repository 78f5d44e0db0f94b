"""Displacements v that meet supports and bonds, do not penetrate, and take lawful forces λ̂ at their word.

Bodies stand where their forces balance, at u + R y. From there v = u + R y + δ, δ on the boundary dofs alone, is the nearest in the
norm of the stiffness's diagonal D of all those that keep what the laws hold rigidly beside λ̂: bonds closed, sides that press on
each other in touch, what sticks where it stuck. The law says what is held: at d̂ = (F − λ̂)/keq, which is lawful beside λ̂,
those directions in which ∂f̂/∂F is as stiff as the search direction itself. Directions in which a law gives way, such as slip, are free
where the law can price them (``Law.duality_gap``), and held elsewhere. Also free is what costs less than mending it, such as a gap under
next to no pressure. What v then breaks is held too, until it breaks nothing. Where a price is above what mending would cost, these
directions are held as well, if all of it together becomes cheaper. Where several interfaces meet in a node, λ̂ may hold them in ways
that are at odds with each other: then what lies across their normals is let go, for its price.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Answer
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.stopping.continuity import Continuity

RIGID = 1 - 1e-9  # singular value of ∂f̂/∂F from which a direction is held
FELT = 1e-9  # the same where a law cannot price what it breaks
EXACT = 1e-12  # of the jumps, what is broken by rounding alone
WORTH = 1e-2  # of the cost, below which no price is worth mending
PASSES = 20  # in which what v breaks is held


@dataclass(frozen=True)
class Held:
    """Directions in which laws hold jumps, r of them.

    at : (r,) int, pairs; directions : (r, 3) unit vectors
    goals : (r,) what the jumps there have to be
    rigid : (r,) bool, the law does not give way, or cannot price it
    across : (r,) bool, across the normal, where what slips has a price
    """

    at: np.ndarray
    directions: np.ndarray
    goals: np.ndarray
    rigid: np.ndarray
    across: np.ndarray

    def some(self, chosen: np.ndarray) -> Held:
        """Those that are chosen, (r,) bool or places."""
        return Held(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def and_then(self, other: Held) -> Held:
        """These, and the others behind."""
        return Held(*(np.concatenate([getattr(held, field.name) for held in (self, other)]) for field in fields(self)))

    def of(self, jump: np.ndarray) -> np.ndarray:
        """(r,) jumps (3, P) in these directions."""
        return np.einsum("ri,ir->r", self.directions, jump[:, self.at])


@dataclass(frozen=True)
class Placed:
    """Displacements of one load step.

    v : (B,) on the boundary dofs; jump : (3, P) of it
    gap : (P,) γ of this rank's points, 0 at others
    cost : δᵀDδ + 2Σγ, of all ranks
    admissible : whether v breaks nothing
    """

    v: np.ndarray
    jump: np.ndarray
    gap: np.ndarray
    cost: float
    admissible: bool


@dataclass(frozen=True)
class _Step:
    """What v is sought from: λ̂ (3, P), history, number of the load step, prescribed traces, u + R y (B,) and its means,
    and the largest jump, which rounding is relative to."""

    force: np.ndarray
    before: History
    number: int
    known: np.ndarray | None
    u: np.ndarray
    mean: np.ndarray
    scale: float


class AdmissibleDisplacement:
    """The displacements of one decomposition.

    pairs : points of all interfaces, perfect ones included, without springs
    continuity : with the weights D
    """

    def __init__(self, pairs: Pairs, continuity: Continuity):
        self.pairs, self.continuity, self.space = pairs, continuity, continuity.space
        self.prices, self.slips, lawful = np.zeros((3, len(pairs)), dtype=bool)
        for run in pairs.runs:
            self.prices[run.part], self.slips[run.part] = run.law.prices, run.law.slips
            lawful[run.part] = not run.law.perfect  # perfect ones are the continuity's
        self.mine, self.B = lawful & pairs.mine, sp.csr_array(pairs.transfer.B)

    def __call__(self, u: np.ndarray, known: np.ndarray | None, answer: Answer, F: np.ndarray, before: History,
                 number: int) -> Placed:
        """v of one load step.

        u : (B,) u + R y; known : (D,) prescribed traces; answer : λ̂ at predicted forces F (3, P)
        before : what the load step before has left; number : of the load step
        """
        pairs, team, mean = self.pairs, self.space.team, self.continuity.means(u[None])
        lawful, start = pairs.compliance(F - answer.force), self._jumps(mean, known)
        largest, = team.max(max(np.abs(x).max(initial=0.0) for x in (start, pairs.compliance(F))))
        step = _Step(answer.force, before, number, known, u, mean, largest or 1.0)
        told = pairs.force(F, before, number, derivative=True)
        felt, together = self._held(told, self.mine, lawful), self._together(told, lawful)
        pressed = np.abs(step.force).max(axis=0)
        held = ~self.prices | (self._gap(step, start) + EXACT * step.scale * pressed >= self._mending(felt, start)) & (pressed > 0)
        first = self._placed(step, felt.some(felt.rigid & held[felt.at]), together, self.slips & ~held)
        priced, = team.sum(float(np.count_nonzero(first.gap)))
        dear = first.gap > np.maximum(self._mending(felt, first.jump), WORTH * first.cost / (2 * max(priced, 1.0)))
        if not team.max(float(dear.any()))[0]:
            return first
        other = self._placed(step, felt.some(felt.rigid & held[felt.at] | dear[felt.at]), together, self.slips & ~held & ~dear)
        return other if other.admissible and (other.cost < first.cost or not first.admissible) else first

    def _mending(self, felt: Held, jump: np.ndarray) -> np.ndarray:
        """(P,) about what it costs to bring jumps (3, P) to where laws feel nothing."""
        points, result = self.pairs.points, np.zeros(len(self.pairs))
        stiff = np.where(felt.across, points.stiff_t[felt.at], points.stiff_n[felt.at])
        np.add.at(result, felt.at, 0.5 * stiff * (felt.of(jump) - felt.goals) ** 2)
        return result

    def _placed(self, step: _Step, held: Held, together: tuple[Held, sp.csr_array], free: np.ndarray) -> Placed:
        """The nearest v that keeps what is held, alone or together with others, and whatever it would break; pairs that are ``free``
        (P,) may slip."""
        continuity, team, base, let_go = self.continuity, self.space.team, step.mean, free.copy()
        for _ in range(PASSES):
            mean = self._nearest(step, base, held, *together)
            jump = self._jumps(mean, step.known)
            at_odds = held.across & (np.abs(held.of(jump) - held.goals) > EXACT * step.scale)
            let_go[held.at[at_odds]] = True
            if team.max(float(at_odds.any()))[0]:  # the least that has to give way does
                base = mean
            broken = self._broken(step, jump)
            broken = broken.some(~(broken.across & let_go[broken.at]))
            admissible = not team.max(float(len(broken.at) + at_odds.sum()))[0]
            if admissible:
                break
            held = held.some(~(held.across & let_go[held.at])).and_then(broken)
        v, gap = continuity.of_means(mean)[0], self._gap(step, jump)
        cost, = team.sum(float(continuity.weight @ (v - step.u) ** 2) + 2 * gap.sum())
        return Placed(v, jump, gap, float(cost), admissible)

    def _nearest(self, step: _Step, base: np.ndarray, held: Held, joint: Held, common: sp.csr_array) -> np.ndarray:
        """(1, classes) the means nearest to ``base`` that keep what is held, and what is held jointly but for common jumps (r, groups)."""
        own, alone = self.continuity.rows, len(held.at)
        rows = sp.csr_array(sp.vstack([self._rows(held), self._rows(joint), own]))
        lack = rows @ self.continuity.traces(base, step.known)[0]
        lack -= np.concatenate([held.goals, joint.goals, np.zeros(own.shape[0])])
        if self.pairs.slid is not None:
            lack[:alone] += held.of(self.pairs.slid)
        loose, groups = None, common.shape[1]
        if groups:
            loose = sp.csr_array(sp.vstack([sp.csr_array((alone, groups)), common, sp.csr_array((own.shape[0], groups))]))
        return base - self.continuity.constrained(rows, loose)(lack[None])

    def _broken(self, step: _Step, jump: np.ndarray) -> Held:
        """What laws would hold that jumps (3, P) break beside λ̂."""
        pairs, least = self.pairs, EXACT * step.scale
        there = pairs.force(step.force + pairs.points.stiffness(jump), step.before, step.number, derivative=True)
        lacks = pairs.compliance(step.force - there.force)
        broken = self._held(there, self.mine & (np.abs(lacks).max(axis=0) > least), jump + lacks)
        return broken.some(broken.rigid & (np.abs(broken.of(lacks)) > least))

    def _gap(self, step: _Step, jump: np.ndarray) -> np.ndarray:
        """(P,) γ of jumps (3, P) at this rank's points."""
        return self.pairs.duality_gap(step.force, jump, step.before, step.number)

    def _jumps(self, mean: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """(3, P) of means (1, classes)."""
        jump = self.pairs.transfer.jump(self.continuity.traces(mean, known)[0])
        return jump if self.pairs.slid is None else jump + self.pairs.slid

    def _held(self, answer: Answer, chosen: np.ndarray, goal: np.ndarray) -> Held:
        """What the laws hold at those pairs that are chosen (P,), by their answer; ``goal``: (3, P)."""
        kept = chosen[answer.active]
        if answer.collective is not None:  # pairs that answer together are held together
            kept &= ~np.isin(answer.active, answer.collective.at)
        at, slopes = answer.active[kept], answer.derivative.transpose(2, 0, 1)[kept]
        normal = self.pairs.points.normal[:, at].T
        twice = np.eye(3) + normal[:, :, None] * normal[:, None, :]  # of directions that are held alike the normal is one
        _, size, directions = np.linalg.svd(slopes @ twice)
        pair, which = np.nonzero(size > FELT)
        directions, size, at = directions[pair, which], size[pair, which], at[pair]
        priced = self.prices[at]
        across = self.slips[at] & (np.abs(np.einsum("ri,ri->r", directions, normal[pair])) < 0.5)
        held = Held(at, directions, np.zeros(len(at)), ~priced | (size > RIGID), across)
        return replace(held, goals=held.of(goal))

    def _together(self, answer: Answer, goal: np.ndarray) -> tuple[Held, sp.csr_array]:
        """What pairs that answer together hold, and the common jumps (r, groups) that leave them free; ``goal``: (3, P)."""
        groups = [] if answer.collective is None else [(at, given) for at, given, _ in answer.collective.groups() if self.mine[at].any()]
        pairs = np.unique(np.concatenate([np.zeros(0, int), *(at for at, _ in groups)]))
        common = np.zeros((3 * len(pairs), len(groups)))
        for k, (at, given) in enumerate(groups):
            force = np.zeros((3, len(self.pairs)))
            force[:, at] = given
            jump = self.pairs.compliance(force)[:, pairs].T.ravel()
            common[:, k] = jump / np.linalg.norm(jump)
        nothing = np.zeros(3 * len(pairs), dtype=bool)
        held = Held(np.repeat(pairs, 3), np.tile(np.eye(3), (len(pairs), 1)), goal[:, pairs].T.ravel(), ~nothing, nothing)
        return held, sp.csr_array(common)

    def _rows(self, held: Held) -> sp.csr_array:
        """(r, D + G) that make of traces what is held."""
        count, rows = len(self.pairs), len(held.at)
        column = (np.arange(3) * count + held.at[:, None]).ravel()
        return sp.csr_array((held.directions.ravel(), (np.repeat(np.arange(rows), 3), column)), shape=(rows, 3 * count)) @ self.B
