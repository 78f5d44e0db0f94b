"""Energy error where interfaces open, slip or give way: distance to the discrete solution of the
true laws, springs or none.

Per load step two fields are made of an iterate u, w, f:

- λ̂ that the laws allow and under which every body is in balance (``admissible_forces``), and û,
what the bodies do under it,
  K û = f_d − NᵀBᵀλ̂;
- v that meets supports and bonds and does not penetrate (``admissible_displacement``).

With γ ≥ 0, what the law finds that v and λ̂ do not agree in (``Law.duality_gap``: p̂ g where
contact is pressed and open), and the solution u*, λ*, expanding ‖v − û‖² about u* gives

    ‖v − u*‖² + ‖û − u*‖² + 2 Σ [γ(v, λ*) + γ(u*, λ̂)] = E² = ‖v − û‖² + 2 Σ γ(v, λ̂)

for convex laws, where all terms are ≥ 0: E bounds the error of v, guaranteed (for bonds alone this
is ``stopping.bound``). From interface data alone, with v = u + R y + δ and h = Nᵀ(−Bᵀλ̂ − f),

    ‖v − û‖² = δᵀK_bb δ − 2 δᵀh + hᵀS⁺h.

With Coulomb's friction the limits μ p̂ are those of λ̂, and a load step begins where v ended the
one before: an estimate, but where ``friction`` finds a factor with which E is a bound. It is part
of the errors told.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from orchestrator.laws.points import Answer
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import Blocks, dots, peak
from orchestrator.method.interface.traces import per_node
from orchestrator.method.linear.loading import NOTHING
from orchestrator.method.linear.stage import Admissible, LinearStage
from orchestrator.method.stopping.admissible_displacement import AdmissibleDisplacement
from orchestrator.method.stopping.admissible_forces import AdmissibleForces
from orchestrator.method.stopping.bound import ROUNDING, Reached, moved_energy
from orchestrator.method.stopping.continuity import Continuity
from orchestrator.method.stopping.dual_energy import Enough, dual_energy
from orchestrator.method.stopping.error_estimate import Judged, relative
from orchestrator.method.stopping.friction import guarantee
from orchestrator.method.stopping.softest import BesideRigid, softest
from orchestrator.scene.conditions.rigid import RIGID
from orchestrator.scene.model import Subdomain

# E over the error asked for, up to which it is found: how far the law residual has to fall follows
# from it
USEFUL = 2.0


@dataclass(frozen=True)
class Pair:
    """v and λ̂ of T load steps, this rank's points.

    answers : of the laws, load step by load step, whose force is λ̂; predicted : (T, 3, P) what
        they are asked, F
    delta : (T, B) v − u − R y on the boundary dofs; moved : (T, own modes) y
    jump : (T, 3, P) of v; gap : (T,) Σγ of these points
    before : what load steps begin with, and what the last one leaves, T + 1
    unbalanced : (T, bodies) bool, those that no lawful forces balance
    broken : (T,) bool, load steps in which every displacement breaks a law
    """

    answers: list[Answer]
    predicted: np.ndarray
    delta: np.ndarray
    moved: np.ndarray
    jump: np.ndarray
    gap: np.ndarray
    before: list[History]
    unbalanced: np.ndarray
    broken: np.ndarray

    @cached_property
    def forces(self) -> np.ndarray:
        """(T, 3, P) λ̂."""
        return np.array([answer.force for answer in self.answers])

    @property
    def missing(self) -> bool:
        """Whether there is no such pair."""
        return bool(self.unbalanced.any() or self.broken.any())

    @classmethod
    def joined(cls, batches: Sequence[Pair]) -> Pair:
        """Of all load steps from batches of them, in order."""
        predicted, delta, moved, jump, gap, unbalanced, broken = map(np.concatenate, zip(*(
            (b.predicted, b.delta, b.moved, b.jump, b.gap, b.unbalanced, b.broken)
            for b in batches)))
        before = [*(state for b in batches for state in b.before[:-1]), batches[-1].before[-1]]
        return cls([answer for b in batches for answer in b.answers], predicted, delta, moved, jump,
                   gap, before, unbalanced, broken)


class Certificate:
    """The error of one decomposition.

    pairs : points of all interfaces, perfect ones included, without springs
    stiffness : (B, B) of the subdomains on their boundary dofs
    modes : per own subdomain (boundary dofs, r) rigid motions that its supports leave
    external : (T, B) external nodal forces on the boundary dofs
    pushed : per own subdomain (T, r) what all external forces on it do in these motions
    stage : linear stage of these load steps
    before : what the load step before the first one has left, and the largest energy norm until
        then

    floor : relative energy error of the subdomains' own matrices, where their digits are few
    closely : of the smaller of E² and ‖S⁺h‖², what may be left of the latter in what is delivered
    """

    def __init__(self, pairs: Pairs, stiffness: Blocks, modes: list[np.ndarray],
                 external: np.ndarray, stage: LinearStage,
                 pushed: list[np.ndarray]):
        self.pairs, self.stiffness, self.external, self.stage = pairs, stiffness, external, stage
        self.space, self.before, self.reached, self.floor = stage.space, History.none(
            len(pairs)), 0.0, 0.0
        self.forces = AdmissibleForces(stage.direction, pairs, modes)
        weight = per_node(stiffness.diagonal(), self.space)
        self.displacement = AdmissibleDisplacement(pairs, Continuity(self.space, weight))
        self.beside = BesideRigid(stage, self.forces.u)
        self.pushed = np.zeros((len(external), RIGID, 0)) if not pushed else np.stack(
            [own @ R for own, R in zip(pushed, self.forces.R)],
            axis=2)[:, :, self.beside.of.subdomains]
        softness = cache(partial(softest, stage, self.beside))  # made once, for all load steps
        imposed = np.repeat([i.law.imposed for i in pairs.interfaces], np.diff(pairs.bounds))
        work, = self.space.team.sum(
            float(pairs.points.stiff_n[pairs.mine] @ imposed[pairs.mine] ** 2))
        self.closely = 1e-4  # a hundredth of û − u
        # of bodies that laws carry away, and nothing strains
        self.imposed = NOTHING * float(np.sqrt(work))
        self.factor = guarantee(pairs, stiffness, modes, stage, softness)
        # an estimate does without: it takes a third of the sweeps
        self.softness = lambda: None if np.isnan(self.factor()) else softness()

    def batch(self, steps: slice | np.ndarray, stage: LinearStage,
              earlier: Judged | None) -> Certificate:
        """The certificate of some load steps; ``earlier``: what those before have ended with."""
        part = copy(self)
        part.pairs, part.external, part.stage, part.pushed = self.pairs.batch(steps), self.external[
            steps], stage, self.pushed[steps]
        if earlier is not None:
            part.before, part.reached = earlier.pair.before[-1], earlier.size
        return part

    def estimated(self) -> Certificate:
        """The same, with no factor that makes a bound of it: for load steps that others go
        before.
        """
        part = copy(self)
        part.factor, part.softness = (lambda: np.nan), (lambda: None)
        return part

    def __call__(self, fields: Admissible, asked: float = np.inf) -> Judged:
        """The error of an iterate.

        asked : error asked for; above ``USEFUL`` of it E need not be known: it is infinite then,
            and ``least`` what has been reached
        """
        useful = USEFUL * asked
        pair = self.pair(fields)
        delta = pair.delta
        # rigid motions do no work on forces in balance: what rounding leaves of that, of a body
        # that is far, is more than its energy
        h = self.beside.balanced(self.change(fields, pair.forces))
        a2, energy = moved_energy(self.stage, self.stiffness, self.external, fields, delta)
        energy = energy - self.beside.rigid_work(fields.u - self.stage.loading.carried, self.pushed,
                                                 self.space.loads(fields.f))
        a2, energy, rest = self.space.team.sum(a2, energy, a2 - 2 * dots(delta, h) + 2 * pair.gap)
        size = max(self.stage.loading.size(energy), self.reached, self.imposed)
        a = relative(_largest(a2), size)
        known = Judged("certificate", np.inf, np.nan, np.full(len(a2), np.inf), size, a, energy,
                       pair.moved, delta, pair=pair)
        if a > useful or pair.missing:
            return replace(known, least=a)
        solved, factor, reached = self.stage.blackbox.solved, self.factor(), Reached(
            _largest, size, useful)
        times_at_most = 1.0 if np.isnan(factor) else factor
        met = max(size / (1 + 1 / asked) - self.floor * size,
                  0.0) / times_at_most if np.isfinite(asked) else 0.0
        # what rounding leaves of resultants has no energy
        enough = Enough((ROUNDING * size) ** 2, met=met**2)
        dual = dual_energy(self.stage, h, rest, enough, reached, self.softness())
        known = replace(known, sweeps=(self.stage.blackbox.solved - solved) / len(h))
        if reached.least > useful:
            return replace(known, least=reached.least)
        errors = np.sqrt(np.maximum(rest + dual.energy, 0.0)) * times_at_most + self.floor * size
        return replace(known, relative=relative(float(errors.max()), size), steps=errors,
                       factor=factor, dual=dual)

    def change(self, fields: Admissible, forces: np.ndarray) -> np.ndarray:
        """(T, B) h, what forces λ̂ (T, 3, P) load the bodies with beyond those of fields."""
        change = self.pairs.transfer.opposed(forces) - fields.extended[1]
        return self.space.loads(change[:, : self.space.size])

    def pair(self, fields: Admissible) -> Pair:
        """Return v and λ̂ of fields."""
        pairs, found, before = self.pairs, [], [self.before]
        F, held = pairs.traces(*fields.extended).predicted(), self.stage.loading.known
        # the largest displacement of the interfaces, beside which bodies may move
        radius = max(self.space.team.max(peak(fields.w))[0], np.finfo(float).tiny)
        for t, number in enumerate(pairs.numbers):
            balanced = self.forces(F[t], fields.f[t], before[t], number, radius)
            answer, u = balanced.answer, fields.u[t] + self.forces.displacement(balanced.y)
            known = None if held is None else held[t]
            placed = self.displacement(u, known, answer, balanced.F, before[t], number)
            before.append(History(placed.jump, answer.own))
            found.append((balanced.F, placed.v - u, self.forces.moved(balanced.y), placed.jump,
                          placed.gap.sum(), balanced.unbalanced,
                          not placed.admissible, answer))
        *columns, answers = zip(*found)
        predicted, delta, moved, jump, gap, unbalanced, broken = map(np.array, columns)
        return Pair(list(answers), predicted, delta, moved, jump, gap, before, unbalanced, broken)


def pushed(own: Sequence[Subdomain], modes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per subdomain (T, r) what its external forces do in motions (3n_E, r)."""
    return [s.loads.reshape(len(s.loads), -1) @ m for s, m in zip(own, modes)]


def _largest(squares: np.ndarray) -> float:
    """The largest error of squared ones (T,)."""
    return float(np.sqrt(np.maximum(squares, 0.0).max(initial=0.0)))
