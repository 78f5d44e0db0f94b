"""One load step of the coarse contact problem: its imbalance ρ, and the pairs near enough to matter.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y)

Where contacts are stabilised law(F) is f̂ = (1 − ε) law(F) + ε (F − keq d_before). Its second part is affine, and summed
once: ΣTᵀε L with the bodies, ΣTᵀε(F₀ − keq d_before) with the load step.

Most pairs are open and stay so. With |n·L y| ≤ ‖n·L‖ ‖y‖, those that no fields of the size seen so far can close
are left out, and come back if the fields grow beyond it.

Among ranks, what belongs to an interface is formed by the rank of its first side. ρ is summed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import Answer
from orchestrator.method.coarse.block_pattern import BlockPattern
from orchestrator.method.coarse.pair_fields import FIELDS, PairFields
from orchestrator.parallel.team import Team

REACH = 2.0  # size of the fields that pairs must be able to close at, over the size last seen


@dataclass
class Bodies:
    """What the load steps have in common.

    Parameters
    ----------
    team : the ranks
    count : number of bodies, of all ranks
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, 12, 12) stiffness of the fields
    counted : int, interfaces that this rank adds up
    order : int, the order of all ranks' interfaces, which must not depend on the ranks
    pattern : of the Newton matrices, on rank 0
    springs : (I, 24, 24) ΣTᵀε L, what stabilisation adds; None without
    """

    team: Team
    count: int
    fields: PairFields
    K0: np.ndarray
    counted: np.ndarray
    order: np.ndarray
    pattern: BlockPattern | None
    springs: np.ndarray | None

    @classmethod
    def of(cls, team: Team, count: int, own: np.ndarray, fields: PairFields, K0: np.ndarray) -> Bodies:
        """Agree on the order of the interfaces; ``own`` are the bodies of this rank."""
        counted = np.flatnonzero(np.isin(fields.bodies[:, 0], own))
        mine = [fields.pairs.interfaces[i] for i in counted]
        everyones = sum(team.all_gather([(i.index, *i.subdomains) for i in mine]), [])
        order = np.array(sorted(range(len(everyones)), key=everyones.__getitem__), dtype=int)
        ends = np.array([everyones[i][1:] for i in order], dtype=int).reshape(-1, 2)
        pattern = BlockPattern(ends, count, FIELDS) if team.rank == 0 else None
        weight, springs = fields.pairs.stabilisation, None
        if weight is not None:
            every = np.arange(len(weight))
            springs = fields.slopes(Answer(np.zeros((3, 0)), every, every, weight * np.eye(3)[:, :, None]))
        return cls(team, count, fields, K0, counted, order, pattern, springs)


class LoadStep:
    """ρ of one load step, and its derivative.

    Parameters
    ----------
    bodies : what all load steps share
    F0 : (3, P) predicted forces
    resultant : (bodies, 12) Uᵀf
    previous : (3, P) jump at the end of the load step before
    reach : (I,) size of the two bodies' fields up to which the pairs left out cannot close; grows if need be

    Attributes
    ----------
    seen : (I,) largest size of the fields so far
    """

    def __init__(self, bodies: Bodies, F0: np.ndarray, resultant: np.ndarray, previous: np.ndarray, reach: np.ndarray):
        self.bodies, self.F0, self.resultant, self.previous, self.reach = bodies, F0, resultant, previous, reach
        self.seen = np.zeros_like(reach)
        if bodies.springs is not None:
            pairs = bodies.fields.pairs
            self.resisted = bodies.fields.carried(pairs.stabilisation * pairs.resisted(F0, previous))
        self._choose()

    def _choose(self) -> None:
        fields = self.bodies.fields
        if np.isfinite(self.reach).all():
            change = fields.normal_size * np.repeat(self.reach, np.diff(fields.pairs.bounds))
            near = np.flatnonzero(~fields.pairs.idle(self.F0, change))
            self.fields = fields.some(near)
            self.F0_near, self.before = self.F0.take(near, axis=1), self.previous.take(near, axis=1)
        else:
            self.fields, self.F0_near, self.before = fields, self.F0, self.previous

    def residual(self, y: np.ndarray) -> np.ndarray:
        """(bodies, 12) ρ; the forces that it was formed with are kept for ``matrix``."""
        bodies = self.bodies
        size = np.linalg.norm(self.fields.both(y), axis=1)
        self.seen = np.maximum(self.seen, size)
        if (size > self.reach).any():
            self.reach = np.maximum(self.reach, REACH * self.seen)
            self._choose()
        self.F = self.fields.predicted(self.F0_near, y)
        sums = self._lawful(self.fields.pairs.force(self.F, self.before).force)
        if bodies.springs is not None:
            sums = sums + self.resisted + np.einsum("ifg,ig->if", bodies.springs, bodies.fields.both(y))
        sums = sums[bodies.counted]
        firsts, seconds = bodies.fields.bodies[bodies.counted].T
        carried = np.zeros((bodies.count, FIELDS))
        np.add.at(carried, firsts, sums[:, :FIELDS])
        np.add.at(carried, seconds, sums[:, FIELDS:])
        carried, = bodies.team.sum(carried)
        return self.resultant + np.einsum("bij,bj->bi", bodies.K0, y) - carried

    def matrix(self) -> np.ndarray | bool:
        """Values of K₀ − ΣTᵀA L at the last forces, for the pattern; False where that is not: all but rank 0."""
        bodies = self.bodies
        answer = self.fields.pairs.force(self.F, self.before, derivative=True)
        if bodies.springs is not None:
            answer.derivative = (1 - self.fields.pairs.stabilisation[answer.active]) * answer.derivative
        slopes = self.fields.slopes(answer)
        if bodies.springs is not None:
            slopes = slopes + bodies.springs
        everyone = bodies.team.gather(slopes[bodies.counted])
        return bodies.pattern.values(-np.concatenate(everyone)[bodies.order], bodies.K0) if everyone else False

    def _lawful(self, force: np.ndarray) -> np.ndarray:
        """(I, 24) the laws' share of the moments."""
        if self.bodies.springs is not None:
            force = (1 - self.fields.pairs.stabilisation) * force
        return self.fields.carried(force)

    def forces(self, y: np.ndarray) -> np.ndarray:
        """(3, P) F₀ + L y at all pairs."""
        return self.bodies.fields.predicted(self.F0, y)

    @property
    def reach_next(self) -> np.ndarray:
        """(I,) the reach to begin this load step with at the next iteration."""
        return REACH * self.seen
