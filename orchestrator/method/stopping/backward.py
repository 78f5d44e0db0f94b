"""Backward error: what is delivered is exact for surfaces that are shifted a little, whatever the
friction and the history.

The bodies under forces λ̂ that obey the laws and keep every body in balance
(``admissible_forces``),

    K û = f_d − NᵀBᵀλ̂,    on the boundary û = u + R y + S⁺h,    h = Nᵀ(−Bᵀλ̂ − f),

solve the scene exactly, with its loads, moduli and laws, if each pair's jump is offset by δ = d' −
B û, where d' is a jump that the law allows beside λ̂: λ̂ = law(λ̂ + keq d'), with d' of the load
step before as its history. Of such jumps one near B û is found from B û on by

    d ← d + (λ̂ − law(λ̂ + keq d))/keq.

Where this stands still does not depend on keq: the softer keq is beside λ̂, the nearer to B û that
is, and the fewer steps it takes. No law is asked for its name. Where nothing is found, and always
where laws have variables of their own, it is d̂ = (F − λ̂)/keq of the balance. Where the laws do
not hold to rounding beside the jumps that are found, nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from orchestrator.laws.points import norm
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import ROUNDING
from orchestrator.method.stopping.certificate import Certificate
from orchestrator.method.stopping.dual_energy import Enough, dual_energy
from orchestrator.method.stopping.error_estimate import Judged

# of the largest force: what a jump is improved to, and what is a law's to rounding
EXACT, LAWFUL = 1e-13, 1e-12
FAR = 8 * np.finfo(float).eps  # of what a jump is worth as a force, which is its rounding
# keq d over λ̂, step by step: each of the first gains three digits, and stiffer ones mend what they
# round; what then is still at odds, as
# what hardly sticks, takes softer ones
STIFFER = 1e-3, 1e-3, 1e-1, 1.0
SOFT = *[1e-3] * 3, *STIFFER, 1e-6, 1e-9, 1e-12, 1e-9, 1e-6, *STIFFER
LEAST = 1e-15  # the same over keq, where nothing is carried
SEEN = 1e-3  # of the force in one direction, what counts in the other: less may be rounding


@dataclass(frozen=True)
class Backward:
    """Surfaces' shifts for which a solution is exact, T load steps and P points of this rank.

    jump, shift : (T, 3, P) d' and δ
    normal, tangential : (T,) largest |n·δ|, and largest δ across n, of all ranks;
    """

    jump: np.ndarray
    shift: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray


@dataclass(frozen=True)
class Solved:
    """Load steps that were solved.

    certificate, bound : their error; fields : of the linear stage; u : (T, B) boundary
        displacements u + R y
    x : (T, B) S⁺h where it is known; None: it is found here
    """

    certificate: Certificate
    bound: Judged
    fields: Admissible
    u: np.ndarray
    x: np.ndarray | None = None

    def jumps(self) -> np.ndarray:
        """(T, 3, P) B û; not finite where it is not known."""
        c, x = self.certificate, self.x
        if x is None:
            nothing = (ROUNDING * self.bound.size) ** 2 / c.closely
            h = c.beside.balanced(c.change(self.fields, self.bound.pair.forces))
            left, _, x, *_ = dual_energy(c.stage, h, np.zeros(len(self.u)),
                                         Enough(nothing, c.closely), softness=c.softness())
            x = np.where(np.isfinite(left)[:, None], x, np.nan)
        return c.pairs.transfer.jump(c.space.extended(c.stage.trace(self.u + x))[0])


def backward_error(solved: Solved,
                   between: Mapping[int,
                                    Sequence[Solved]] = MappingProxyType({})) -> Backward | None:
    """The shifts for a solution; None where no lawful forces balance the bodies, or no jump is
    found that goes with them.

    between : load steps, from 0, before which others were solved of which nothing is delivered →
        these, one each
    """
    everything = [solved, *(part for parts in between.values() for part in parts)]
    if any(part.bound.pair.unbalanced.any() for part in everything):
        return None
    team, points = solved.certificate.space.team, solved.certificate.pairs.points
    largest, = team.max(
        max(np.finfo(float).tiny, *(peak(part.bound.pair.forces) for part in everything)))
    jumps, before, found, at_odds = solved.jumps(), History.none(
        len(solved.certificate.pairs)), [], False
    for t, own in enumerate(jumps):
        path = [*((part, 0, part.jumps()[0]) for part in between.get(t, ())), (solved, t, own)]
        for part, row, near in path:
            pair, pairs = part.bound.pair, part.certificate.pairs
            force, number = pair.forces[row], pairs.numbers[row]
            jump = _lawful(pairs, force, near, pairs.compliance(pair.predicted[row] - force),
                           before, number, largest)
            answer, off = _judged(pairs, force, jump, before, number, largest)
            at_odds, before = at_odds or not (off <= LAWFUL).all(), History(jump, answer.own)
        found.append(jump)
    if team.max(float(at_odds))[0]:
        return None
    shift = np.array(found) - jumps
    along, across = np.abs(points.along(shift)), points.across(shift)
    normal, tangential = (np.array(team.max(*x.max(axis=1, initial=0.0)))
                          for x in (along, norm(across)))
    return Backward(np.array(found), shift, normal, tangential)


def _lawful(pairs: Pairs, force: np.ndarray, jump: np.ndarray, known: np.ndarray, before: History,
            number: int,
            largest: float) -> np.ndarray:
    """(3, P) jumps that the laws allow beside forces (3, P), near those given; ``known``: where
    none is found.

    Pairs that are lawful already stay, and those that answer together keep their weights.
    """
    F = force + pairs.points.stiffness(jump)
    collective = pairs.force(F, before, number, derivative=True).collective
    together = np.zeros(0, int) if collective is None else collective.at
    own = np.zeros(len(pairs), dtype=bool)
    for run in pairs.runs:
        own[run.part] = bool(run.law.variables)
    jump = np.where(own, known, jump)
    for step, soft in enumerate(SOFT):
        _, off = _judged(pairs, force, jump, before, number, largest)
        if not (off > EXACT).any():
            return jump
        softer = _softer(pairs, force, jump, soft, together)
        left = force - softer.force(force + softer.points.stiffness(jump), before, number).force
        if not step:  # the normal alone, on which limits of friction depend
            left = pairs.points.along(left) * pairs.points.normal
        jump = np.where(off > EXACT, jump + softer.compliance(left), jump)
    _, off = _judged(pairs, force, jump, before, number, largest)
    return np.where(off > LAWFUL, known, jump)


def _judged(pairs: Pairs, force: np.ndarray, jump: np.ndarray, before: History, number: int,
            largest: float) -> tuple:
    """The laws' answer to forces λ̂ and jumps (3, P), and (P,) how far it is from λ̂ beyond
    rounding, over the largest force.
    """
    worth = pairs.points.stiffness(jump)
    answer = pairs.force(force + worth, before, number)
    off = np.abs(answer.force - force).max(axis=0,
                                           initial=0.0) - FAR * np.abs(worth).max(
                                               axis=0, initial=0.0)
    return answer, off / largest


def _softer(pairs: Pairs, force: np.ndarray, jump: np.ndarray, soft: float,
            together: np.ndarray) -> Pairs:
    """The same pairs with a keq so soft that jumps are worth a share ``soft`` of forces, along the
    normal and across it; those that answer
    ``together`` (r,) int as they are."""
    points = pairs.points
    carried, moved = (np.array([np.abs(points.along(x)), norm(points.across(x))])
                      for x in (force, jump))
    worth = np.array([points.stiff_n, points.stiff_t]) * moved
    carried = np.maximum(carried, SEEN * carried[::-1])
    share = np.divide(soft * carried, worth, out=np.ones_like(worth),
                      where=worth > 0).clip(LEAST, 1.0)
    share[:, together] = 1.0
    return replace(pairs,
                   runs=[
                       replace(run,
                               points=replace(run.points,
                                              stiff_n=run.points.stiff_n * share[0, run.part],
                                              stiff_t=run.points.stiff_t
                                              * share[1, run.part])) for run in pairs.runs])
