"""Displacements v that meet supports and bonds, do not penetrate, and take lawful forces λ̂ at
their word.

Bodies stand where their forces balance, at ū = u + R y. The best v is the one nearest to it, in the
norm of the stiffness's diagonal D, with what the laws charge beside λ̂, of all those that break no
law:

    min ½ ‖v − ū‖²_D + Σ γ(B v, λ̂)

Where laws are the slopes of energies this is convex, and the forces that D needs are lawful: D (v −
ū) = −Bᵀ(λ − λ̂), λ = law(λ + k B v), whatever k. With k = (B D⁻¹Bᵀ)⁻¹ point by point, λ = law(λ̂ +
k B ū) is the answer, in closed form, where a node is in one pair alone. Where pairs share nodes,
one step of Newton's method from there has to do: with λ⁺ and d⁺ of the closed form, A = ∂f̂/∂F,

    v = ū − D⁻¹Bᵀ(λ⁺ − λ̂ + y),     B v = d⁺ + (1 − a)/(a k) y     in the directions in which A
    stretches by a > 0

Where a = 1 the law holds the jump: sides that press, what sticks. What v breaks all the same is
held as well: any v that breaks nothing serves. Laws that cannot price what they give way by
(``Law.duality_gap``) are kept to the letter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Answer, norm
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak, ratio
from orchestrator.method.stopping.continuity import Constraint, Continuity
from orchestrator.method.stopping.held_jumps import ALONG, HeldJumps

RIGID = 1 - 1e-9  # a from which a direction is held
# a of what sticks: it gives way to what must not penetrate, where pairs around a node are at odds
STICKS = 1 - 1e-6
FELT = 1e-9  # a from which it counts
ROUNDED = 1e-14  # of displacements, what rounding leaves of jumps; they cost the root of that
EXACT = 1e-12  # of the jumps, what is broken by rounding alone
PASSES = 20  # in which what v breaks is held
FREE = 1e4  # over the softest point, how soft pairs that move together are where they do


@dataclass(frozen=True)
class Placed:
    """Displacements of one load step.

    v : (B,) on the boundary dofs; jump : (3, P) of it
    gap : (P,) γ of this rank's points, 0 at others
    admissible : whether v breaks nothing
    """

    v: np.ndarray
    jump: np.ndarray
    gap: np.ndarray
    admissible: bool


class AdmissibleDisplacement:
    """The displacements of one decomposition.

    pairs : points of all interfaces, perfect ones included, without springs
    continuity : with the weights D
    """

    def __init__(self, pairs: Pairs, continuity: Continuity):
        self.pairs, self.continuity, self.space = pairs, continuity, continuity.space
        self.prices, self.slips, lawful = np.zeros((3, len(pairs)), dtype=bool)
        for run in pairs.runs:
            self.prices[run.part], self.slips[run.part] = bool(run.law.duality_gap), run.law.slips
            lawful[run.part] = not run.law.perfect  # perfect ones are the continuity's
        self.mine = lawful & pairs.mine
        self.own, self.ties = np.flatnonzero(self.mine), self.continuity.rows.shape[0]

    @cached_property
    def rows(self) -> sp.csr_array:
        """(3 own points + ties, D + G) all jumps that may be held, component by component, and
        those of bonds whose nodes do not match.
        """
        components = np.arange(3)[:, None] * len(self.pairs) + self.own
        return sp.vstack([self.pairs.transfer.B[components.ravel()], self.continuity.rows])

    @cached_property
    def linked(self) -> Constraint:
        """Return what forces at the points do to all jumps; all ranks have to ask."""
        return self.continuity.constrained(self.rows)

    @cached_property
    def beside(self) -> Pairs:
        """The pairs, with the k that bodies of stiffness D have at a point, where laws have prices;
        all ranks have to ask.
        """
        softness, count = np.zeros(len(self.pairs)), len(self.own)
        softness[self.own] = self.linked.matrix.diagonal()[self.linked.mine[: 3 * count]].reshape(
            3, count).max(axis=0)
        there, points = self.prices & (softness > 0), self.pairs.points
        stiff = ratio(1, softness, there)
        normal, across = (np.where(there, stiff, k) for k in (points.stiff_n, points.stiff_t))
        return replace(self.pairs,
                       runs=[
                           replace(run,
                                   points=replace(run.points, stiff_n=normal[run.part],
                                                  stiff_t=across[run.part]))
                                         for run in self.pairs.runs])

    def __call__(self, u: np.ndarray, known: np.ndarray | None, answer: Answer, F: np.ndarray,
                 before: History,
                 number: int) -> Placed:
        """v of one load step.

        u : (B,) u + R y; known : (D,) prescribed traces; answer : λ̂ at predicted forces F (3, P)
        before : what the load step before has left; number : of the load step
        """
        pairs, team, mean = self.beside, self.space.team, self.continuity.means(u[None])
        force, jump = answer.force, self._jumps(mean, known)
        scale, farthest = team.max(max(peak(x) for x in (jump, self.pairs.compliance(F))),
                                   peak(u))
        rounded = ROUNDED * max(scale, farthest) * norm(force)  # v is known to that
        there = np.where(self.prices, force + pairs.points.stiffness(jump), F)
        told = pairs.force(there, before, number, derivative=True)
        lawful, change = pairs.compliance(there - told.force), np.where(
            self.prices, told.force - force, 0.0)
        mean = mean - self.linked.moved(
            np.concatenate([change[:, self.own].ravel(), np.zeros(self.ties)])[None])
        held, together = self._held(told, self.mine, lawful), self._together(told, lawful)
        for _ in range(PASSES):
            v = self._nearest(mean, known, held, *together)
            jump = self._jumps(v, known)
            more = self._broken(force, jump, EXACT * scale, before, number)
            odd = (held.soft == 0) & ~held.priced & (
                np.abs(held.of(jump) - held.goals) > EXACT * scale)
            wrong, unheld = team.max(float(odd.any() or len(more.at)), float(len(more.at)))
            if not unheld:
                break
            held = held.and_then(more)
        gap = self.pairs.duality_gap(force, jump, before, number)
        return Placed(self.continuity.of_means(v)[0], jump, np.maximum(gap - rounded, 0.0),
                      not wrong)

    def _nearest(self, mean: np.ndarray, known: np.ndarray | None, held: HeldJumps,
                 joint: HeldJumps,
                 common: sp.csr_array) -> np.ndarray:
        """(1, classes) the means nearest to ``mean`` that keep what is held, and what is held
        jointly but for common jumps (r, groups)."""
        both, count, ties = held.and_then(joint), len(self.own), np.arange(self.ties)
        column = np.arange(3) * count + np.searchsorted(self.own, both.at)[:, None]
        ends = np.concatenate([3 * np.arange(len(both.at) + 1), 3 * len(both.at) + 1 + ties])
        pick = sp.csr_array((np.concatenate([both.directions.ravel(), np.ones(self.ties)]),
                             np.concatenate([column.ravel(), 3 * count + ties]), ends),
                            shape=(len(ends) - 1, 3 * count + self.ties))
        now = self.rows @ self.continuity.traces(mean, known)[0]
        now[: 3 * count] += self.pairs.slid[:, self.own].ravel()
        lack = pick @ now - np.concatenate([both.goals, np.zeros(self.ties)])
        soft = sp.diags_array(np.concatenate([both.soft, np.zeros(self.ties)]))
        if common.shape[1]:
            rest = FREE * self.linked.matrix.diagonal().max() * (common @ common.T)
            soft = soft + sp.block_diag([sp.csr_array((len(held.at),) * 2), rest,
                                         sp.csr_array((self.ties,) * 2)])
        return mean - self.linked.some(pick, soft).held(lack[None])

    def _broken(self, force: np.ndarray, jump: np.ndarray, least: float, before: History,
                number: int) -> HeldJumps:
        """Return what laws hold whatever the price that jumps (3, P) break by more than ``least``,
        beside
        λ̂ (3, P) where they have no price.
        """
        pairs, force = self.beside, np.where(self.prices, 0.0, force)
        there = pairs.force(force + pairs.points.stiffness(jump), before, number, derivative=True)
        lacks = pairs.compliance(force - there.force)
        broken = self._held(there, self.mine & (np.abs(lacks).max(axis=0) > least), jump + lacks)
        kept = broken.along(pairs.points.normal) | ~self.slips[broken.at]
        broken = broken.some((broken.soft == 0) & (np.abs(broken.of(lacks)) > least) & kept)
        return replace(broken, priced=np.zeros(len(broken.at), dtype=bool))

    def _jumps(self, mean: np.ndarray, known: np.ndarray | None) -> np.ndarray:
        """(3, P) of means (1, classes)."""
        return self.pairs.transfer.jump(self.continuity.traces(mean, known)[0]) + self.pairs.slid

    def _held(self, answer: Answer, chosen: np.ndarray, goal: np.ndarray) -> HeldJumps:
        """Return what the laws hold at those pairs that are chosen (P,), by their answer; ``goal``:
        (3,
        P).
        """
        kept = chosen[answer.active]
        if answer.collective is not None:  # pairs that answer together are held together
            kept &= ~np.isin(answer.active, answer.collective.at)
        at, slope = answer.active[kept], answer.derivative.transpose(2, 0, 1)[kept]
        normal, slips = self.beside.points.normal[:, at].T, self.slips[at, None, None]
        along = normal[:, :, None] * normal[:, None, :]
        # limits of friction stay as they are: what slips has nothing that is along the normal and
        # across it at once
        apart = slope - along @ slope - slope @ along + 2 * along @ slope @ along
        slope = np.where(slips, apart, slope)
        slope = (slope + slope.swapaxes(1, 2)) / 2
        # of directions that are held alike the normal is one
        _, ways = np.linalg.eigh(slope + slips * along)
        size = np.einsum("pij,pik,pkj->pj", ways, slope, ways)
        pair, which = np.nonzero(np.where(self.prices[at][:, None], size, np.abs(size)) > FELT)
        size, at = size[pair, which], at[pair]
        priced, directions = self.prices[at], ways[pair, :, which]
        across = np.abs(np.einsum("hc,hc->h", directions, normal[pair])) <= ALONG
        size = np.where(priced & self.slips[at] & across, np.minimum(size, STICKS), size)
        gives = priced & (size < RIGID)
        soft = ratio(1 - size, size * self.beside.points.stiff_n[at], gives)
        held = HeldJumps(at, directions, np.zeros(len(at)), soft, priced & ~gives)
        return replace(held, goals=held.of(goal))

    def _together(self, answer: Answer, goal: np.ndarray) -> tuple[HeldJumps, sp.csr_array]:
        """Return what pairs that answer together hold, and the common jumps (r, groups) that leave
        them
        free; ``goal``: (3, P).
        """
        groups = [] if answer.collective is None else [(at, given)
                                                       for at, given, _ in answer.collective.groups(
                                                           ) if self.mine[at].any()]
        pairs = np.unique(np.concatenate([np.zeros(0, int), *(at for at, _ in groups)]))
        common = np.zeros((3 * len(pairs), len(groups)))
        for k, (at, given) in enumerate(groups):
            force = np.zeros((3, len(self.pairs)))
            force[:, at] = given
            jump = self.pairs.compliance(force)[:, pairs].T.ravel()
            common[:, k] = jump / np.linalg.norm(jump)
        none = np.zeros(3 * len(pairs))
        held = HeldJumps(np.repeat(pairs, 3), np.tile(np.eye(3), (len(pairs), 1)),
                         goal[:, pairs].T.ravel(), none, none > 0)
        return held, sp.csr_array(common)
