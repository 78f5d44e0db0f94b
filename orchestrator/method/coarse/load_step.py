"""One load step of the coarse contact problem: its imbalance ρ, and the pairs near enough to
matter.

    ρ(y) = Uᵀf + K₀ y − Σ_pairs Tᵀ law(F₀ + L y)

Where contacts are stabilised law(F) is f̂ = (1 − ε) law(F) + ε (F − keq d_before). Its second part
is affine, and summed once: ΣTᵀε L with the bodies, ΣTᵀε(F₀ − keq d_before) with the load step.

Among ranks, what belongs to an interface is formed by one that touches it, see ``dealt``. ρ is
summed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Answer
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.interface.pairs import History
from orchestrator.method.sparse.blocks import BlockPattern, SharedFactors
from orchestrator.parallel.team import Team


@dataclass
class Bodies:
    """Bodies, as all load steps have them.

    team : the ranks
    fields : at the node pairs of all interfaces that this rank touches
    K0 : (bodies, n, n) stiffness of the fields
    counted : int, interfaces that this rank adds up; theirs : (P,) bool, their node pairs
    pattern : of the Newton matrices
    weight : (P,) 1 − ε, the laws' share
    springs : Σ over these interfaces of ΣTᵀε L, what stabilisation adds; None without
    affine : (k, n, n) K₀ − ΣTᵀε L of all ranks, the pattern's blocks
    """

    team: Team
    fields: PairFields
    K0: np.ndarray
    counted: np.ndarray
    theirs: np.ndarray
    pattern: BlockPattern
    weight: np.ndarray
    springs: sp.sparray | None
    affine: np.ndarray

    @cached_property
    def resisting(self) -> np.ndarray:
        """(P,) ε of the pairs that this rank adds up, 0 at others."""
        return np.where(self.theirs, self.fields.pairs.stabilisation, 0.0)

    @cached_property
    def summed(self) -> tuple[np.ndarray, PairFields]:
        """The pairs that this rank adds up, (Q,) int, and the fields at them."""
        chosen = np.flatnonzero(self.theirs)
        return chosen, self.fields if len(chosen) == len(self.theirs) else self.fields.some(chosen)

    @classmethod
    def of(cls, team: Team, own: np.ndarray, fields: PairFields, K0: np.ndarray,
           rigid: int = 0) -> Bodies:
        """Deal out the interfaces; ``own`` are the bodies of this rank. ``rigid`` : as for
        ``BlockPattern``.
        """
        chosen = dealt(team, own, fields)
        counted, theirs = np.flatnonzero(chosen), np.repeat(chosen, np.diff(fields.pairs.bounds))
        pattern = BlockPattern(fields.ends[counted], fields.count, fields.size, team, rigid)
        return cls(team, fields, K0, counted, theirs, pattern, np.ones(len(theirs)), None,
                   None).stabilised(fields)

    def stabilised(self, fields: PairFields) -> Bodies:
        """The same at pairs with these springs."""
        counted, weight, springs = self.counted, np.ones(len(self.theirs)), None
        slopes = np.zeros((len(counted), 2, 2, fields.size, fields.size), fields.all_L.dtype)
        if fields.pairs.stabilisation is not None:
            epsilon = fields.pairs.stabilisation
            weight, every = 1 - epsilon, np.arange(len(self.theirs))
            slopes = fields.slopes(Answer(np.zeros((3, 0)), every, every,
                                          np.repeat(np.eye(3)[:, :, None], len(every), axis=2)),
                                   epsilon)[counted]
            springs = self.pattern.matrix(self.pattern.summed(slopes))
        return replace(self, fields=fields, weight=weight, springs=springs,
                       affine=self.pattern.values(-slopes, self.K0))


class LoadStep:
    """ρ of one load step, and its derivative.

    bodies : what all load steps share
    number : of the load step in the scene
    F0 : (3, P) predicted forces
    resultant : (bodies, n) Uᵀf
    before : what the load step before has left
    anchor : (3, P) jump at which springs carry nothing; None: the one before
    F, stiff, sprung : (3, Q) forces at the pairs that this rank adds up, (bodies, n) K₀ y and its
        ΣTᵀε L y, with which ρ was formed last
    """

    def __init__(self, bodies: Bodies, number: int, F0: np.ndarray, resultant: np.ndarray,
                 before: History,
                 anchor: np.ndarray | None = None):
        self.bodies, self.number = bodies, number
        self.F0, self.resultant, self.before = F0, resultant, before
        self.resisted = np.zeros_like(resultant)
        if bodies.springs is not None:
            resisted = bodies.fields.pairs.resisted(F0, before.jump if anchor is None else anchor)
            self.resisted = bodies.fields.carried(resisted, bodies.resisting)
        chosen, self.fields = bodies.summed
        whole = len(chosen) == F0.shape[1]
        self.here, self.left = (F0, before) if whole else (F0.take(chosen, axis=1),
                                                           before.take(chosen))

    def residual(self, y: np.ndarray) -> np.ndarray:
        """(bodies, n) ρ; the forces that it was formed with are kept for ``matrix``."""
        self.F = self.fields.predicted(self.here, y)
        self.stiff, self.sprung = self.linear(y)
        return self.imbalance(self.answer(self.F).force)

    def answer(self, F: np.ndarray, derivative: bool = False) -> Answer:
        """Return what the laws say at forces (3, Q)."""
        return self.fields.pairs.force(F, self.left, self.number, derivative=derivative)

    def linear(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, n) K₀ y, and ΣTᵀε L y of this rank's interfaces."""
        bodies = self.bodies
        stiff = np.einsum("bij,bj->bi", bodies.K0, y)
        return stiff, np.zeros_like(y) if bodies.springs is None else (
            bodies.springs @ y.ravel()).reshape(y.shape)

    def imbalance(self, force: np.ndarray) -> np.ndarray:
        """(bodies, n) ρ with forces (3, Q)."""
        return self.left_by(*self.bodies.team.sum(self.carried(force, self.sprung)))

    def carried(self, force: np.ndarray, sprung: np.ndarray) -> np.ndarray:
        """(bodies, n) what forces (3, Q) and springs do in the fields: this rank's part."""
        return self.fields.carried(force, self.bodies.weight) + self.resisted + sprung

    def left_by(self, carried: np.ndarray) -> np.ndarray:
        """(bodies, n) ρ where forces and springs of all ranks do that in the fields."""
        return self.resultant + self.stiff - carried

    def matrix(self) -> np.ndarray:
        """Values of K₀ − ΣTᵀA L at the last forces, for the pattern."""
        bodies = self.bodies
        slopes = self.fields.slopes(self.answer(self.F, derivative=True), bodies.weight)
        return bodies.affine - bodies.pattern.values(slopes[bodies.counted])

    def factors(self, matrix: np.ndarray, shift: float) -> SharedFactors:
        """Of (matrix + shift), what solves with it."""
        return self.bodies.pattern.factors(matrix, shift)

    def forces(self, y: np.ndarray) -> np.ndarray:
        """(3, P) F₀ + L y at all pairs."""
        return self.bodies.fields.predicted(self.F0, y)


class Line:
    """A line y + θ dy of one load step, θ from 0 to 1.

    at : the load step, where it formed ρ(y)
    dy : (bodies, n)
    """

    def __init__(self, at: LoadStep, dy: np.ndarray):
        self.at, self.F, self.found, bodies = at, at.F, (None, None, None), at.bodies
        self.dF, self.against = at.fields.swept(dy, bodies.weight)
        self.stiff, self.sprung = at.linear(dy)
        self.start, self.slope = np.vdot(dy, at.resultant + at.stiff), np.vdot(dy, self.stiff)
        self.springs = np.vdot(dy, at.resisted + at.sprung), np.vdot(dy, self.sprung)

    def __call__(self, theta: float) -> float:
        """dy·ρ(y + θ dy), the work of the imbalance."""
        at, carried = self.at, None
        at.F = self.F + theta * self.dF
        force, team = at.answer(at.F).force, at.bodies.team
        work = np.vdot(self.against, force) + self.springs[0] + theta * self.springs[1]
        # many lines end at their first point: what ρ needs there travels along
        if team.size > 1 and theta == 1:
            work, carried = team.sum(work, at.carried(force, at.sprung + theta * self.sprung))
        elif team.size > 1:
            work, = team.sum(work)
        self.found = theta, force, carried
        return float(self.start + theta * self.slope - work)

    def end(self, theta: float) -> np.ndarray:
        """(bodies, n) ρ(y + θ dy), which the load step then stands at."""
        if self.found[0] != theta:
            self(theta)
        at, (_, force, carried) = self.at, self.found
        at.stiff = at.stiff + theta * self.stiff
        at.sprung = at.sprung + theta * self.sprung
        return at.imbalance(force) if carried is None else at.left_by(carried)


def dealt(team: Team, own: np.ndarray, fields: PairFields) -> np.ndarray:
    """(I,) bool, which of the interfaces that this rank touches it adds up; of all ranks each
    interface is one's, and every rank has as many
    node pairs to work on as can be.

    Those that it alone touches are its own. Of those between two ranks the largest go first, each
    to the one that has less.

    own : (b,) int, the bodies of this rank
    """
    inside, index = np.isin(fields.ends,
                            own).all(axis=1), np.array([i.index for i in fields.pairs.interfaces],
                                                       dtype=int)
    pairs = np.diff(fields.pairs.bounds)
    everyones = team.all_gather((pairs[inside].sum(), index[~inside], pairs[~inside]))
    load = np.array([alone for alone, _, _ in everyones], float)
    between = np.concatenate([shared for _, shared, _ in everyones])
    size = np.concatenate([sizes for _, _, sizes in everyones])
    rank = np.repeat(np.arange(team.size), [len(shared) for _, shared, _ in everyones])
    order = np.lexsort((rank, between, -size))  # its two ranks one after the other
    mine = []
    for one, two in order.reshape(-1, 2):
        taker = min(rank[one], rank[two], key=load.__getitem__)
        load[taker] += size[one]
        if taker == team.rank:
            mine.append(between[one])
    return inside | np.isin(index, mine)
