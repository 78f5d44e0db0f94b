"""Influence fields: what a unit motion of a support, of some tets, or a unit jump at an interface, does to bodies that join elsewhere.

What tets C of a body carry, χ·(K_C u), is the work of a field that jumps by χ within the body, r̃ = χ + r with χ for the tets C alone
and r without jumps: a_C(u, χ) = a(u, r̃) − a(u, r), of which the latter is the loads' and nobody else's work.

Any such field r̃ serves to bound a force (``stopping.intervals``); the less its energy, the sharper. A few answers of the black box make
one of nearly the least,

    r̃ = X₀ + Σ αᵢ Xᵢ + e,     Xᵢ = M⁻¹gᵢ,     e = 0 inside,     e = Π(x₀ + Σ αᵢ xᵢ) − x₀ − Σ αᵢ xᵢ on the boundary

with X₀ the answer to the motion χ of a support or of tets, x boundary values, Π the nearest ones that jump as asked, in the norm of the
stiffness's diagonal. K Xᵢ = gᵢ − k xᵢ on the boundary and nothing inside, so that ‖r̃‖² follows from boundary values alone; α makes it
least. gᵢ is what the method would ask of the bodies next if all interfaces were bonded; beside it Xᵢ are the rigid motions of the bodies
that bring jumps nearest to what they are to be. Where interfaces meet in an edge there may be no r̃: what each of them carries there is not
determined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import dots, times
from orchestrator.method.stopping.admissible import AtPoints, Repositioning, RigidModes
from orchestrator.method.stopping.certificate import Certificate
from orchestrator.method.stopping.dual_energy import CANCELLED

SWEEPS = 10  # at most; three to five are usual
GAIN = 0.03  # of an energy, below which another sweep is not worth while
DEPENDENT = 1e-12  # eigenvalue of the fields' Gram matrix, over the largest, that counts as zero
CLOSED = 1e-8  # of a unit jump: none
HARD = 1e6  # of all jumps and forces that there are: what a law is asked, to see in which directions it carries


@dataclass(frozen=True)
class Asked:
    """What n fields are to do.

    jump : (n, 3, P) at the points of all interfaces; start : (n, B) boundary values that have it at its own interface
    known : (n, D) traces of supports' motions, None where no support is on an interface
    answered : (n, B) boundary values of X₀, without χ of tets; energy : (n,) ‖X₀‖²_K of all ranks, with it
    moved : (n,) bool, by χ
    """

    jump: np.ndarray
    start: np.ndarray
    known: np.ndarray | None
    answered: np.ndarray
    energy: np.ndarray
    moved: np.ndarray

    def some(self, chosen: np.ndarray) -> Asked:
        """Some of the fields."""
        return Asked(*(None if x is None else x[chosen] for x in vars(self).values()))


@dataclass(frozen=True)
class Influence:
    """n fields.

    boundary : (n, B) values on the boundary dofs, without χ of tets; forces : (n, B) K r̃ there
    energy : (n,) ‖r̃‖²_K; infinite where there is no such field
    moved : (n,) bool, by a motion χ of a support or of tets
    """

    boundary: np.ndarray
    forces: np.ndarray
    energy: np.ndarray
    moved: np.ndarray


@dataclass(frozen=True)
class _Fields:
    """n fields each of an affine family: boundary values x, forces there of what is harmonic, and e; (n, B) each."""

    x: np.ndarray
    forces: np.ndarray
    e: np.ndarray
    stiff: np.ndarray  # K_bb e

    def work(self, other: _Fields) -> np.ndarray:
        """(n,) a(self, other) of this rank; self is not moved by supports."""
        return dots(self.x, other.forces) + dots(self.forces, other.e) + dots(other.forces, self.e) + dots(self.e, other.stiff)

    def plus(self, factors: np.ndarray, others: list[_Fields]) -> _Fields:
        """Self + Σ factors (n, m) · others."""
        return _Fields(*(own + sum((factors[:, i, None] * getattr(other, name) for i, other in enumerate(others)), np.zeros_like(own))
                         for name, own in vars(self).items()))


class InfluenceFields:
    """The fields of one decomposition and one question."""

    def __init__(self, certificate: Certificate, asked: Asked):
        self.asked, self.stage, self.stiffness = asked, certificate.stage, certificate.stiffness
        self.space, self.continuity, self.pairs = certificate.space, certificate.displacement.continuity, certificate.pairs
        pairs, count = self.pairs, len(self.pairs)
        one = np.repeat([i.law.perfect and i.mortar is None for i in pairs.interfaces], np.diff(pairs.bounds)).astype(bool)
        carries = directions(pairs)  # (3, 3, P)
        at = np.flatnonzero((carries != 0).any(axis=1) & pairs.mine & ~one)  # nodes that bonds make one have no jump of their own
        which, point = at // count, at % count
        columns = (np.arange(3) * count + point[:, None]).ravel()
        rows = sp.csr_array((carries[which, :, point].ravel(), (np.repeat(np.arange(len(at)), 3), columns)), shape=(len(at), 3 * count))
        self.carries = carries
        self.rows = sp.csr_array(rows @ pairs.transfer.B)
        self.goals = times(rows, asked.jump.reshape(len(asked.jump), -1))
        self.constraint = self.continuity.constrained(self.rows) if self.space.team.max(self.rows.shape[0])[0] else None
        rigid = certificate.forces.u  # zero where a body lacks a motion
        self.modes = RigidModes(self.space, [(u := rigid[:, part])[u.any(axis=1)].T for part in self.space.boundary])
        self.reposition = Repositioning(self.space, self.modes, AtPoints(self.stage.direction))

    def __call__(self) -> Influence:
        """The fields of least energy, of those that there are."""
        asked = self.asked
        there = self._off(self._nearest(asked.answered, asked)) <= CLOSED
        boundary, forces, energy = *np.zeros((2, *asked.start.shape)), np.full(len(there), np.inf)
        if there.any():
            self.asked, self.goals = asked.some(there), self.goals[there]
            boundary[there], forces[there], energy[there] = self._least_energy()
        return Influence(boundary, forces, energy, asked.moved)

    def _least_energy(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n, B) boundary values and forces, and (n,) energy."""
        asked, robin = self.asked, self.stage.direction.robin
        held = -robin(asked.answered, asked.known)
        first, others = self._with_rest(asked.answered, held, asked), []
        begun, = self.space.team.sum(2 * dots(first.forces, first.e) + dots(first.e, first.stiff))
        start = energy = asked.energy + begun
        now = first
        for _ in range(SWEEPS):
            sought = now.x + now.e
            free = self.continuity.weight * self._nearest(now.forces / self.continuity.weight, None)
            g = now.forces - held - free + robin(2 * sought - now.x - asked.answered)
            x = self.stage.solve(g)
            others.append(self._with_rest(x, g - robin(x), None))
            others.append(self._with_rest(self._moved(now.x), np.zeros_like(x), None))
            factors, gained = self._least(first, others)
            before, energy, now = energy, start - gained, first.plus(factors, others)
            if np.max((before - energy) / np.maximum(before, np.finfo(float).tiny), initial=0.0) < GAIN:
                break
        energy, start = np.maximum([energy, start], 0.0)  # nothing may be less, by rounding
        return now.x + now.e, now.forces + now.stiff, energy + CANCELLED * start

    def _moved(self, x: np.ndarray) -> np.ndarray:
        """(n, B) the bodies' rigid motions that bring the jumps of boundary values (n, B) nearest to what is asked for."""
        w, = self.space.extended(self.space.trace(x - self.asked.start, self.asked.known))
        return self.modes.moved(self.reposition(w))

    def _with_rest(self, x: np.ndarray, forces: np.ndarray, asked: Asked | None) -> _Fields:
        e = self._nearest(x, asked) - x
        return _Fields(x, forces, e, times(self.stiffness, e))

    def _nearest(self, x: np.ndarray, asked: Asked | None) -> np.ndarray:
        """(n, B) nearest boundary values that jump as asked; None: not at all."""
        start = np.zeros_like(x) if asked is None else asked.start
        mean = self.continuity.means(x - start)
        if self.constraint is not None:
            traces = self.continuity.traces(mean, None if asked is None else asked.known)
            lack = times(self.rows, traces + self.space.extended(self.space.trace(start))[0])
            mean = mean - self.constraint(lack if asked is None else lack - self.goals)
        return self.continuity.of_means(mean) + start

    def _least(self, first: _Fields, others: list[_Fields]) -> tuple[np.ndarray, np.ndarray]:
        """(n, m) α, and (n,) by how much they lower the energy."""
        gram, linear = self.space.team.sum(np.array([[a.work(b) for b in others] for a in others]),
                                           np.array([a.work(first) for a in others]))
        gram = 0.5 * (gram + gram.swapaxes(0, 1)).transpose(2, 0, 1)
        factors = -np.einsum("nij,jn->ni", np.linalg.pinv(gram, rcond=DEPENDENT, hermitian=True), linear)
        return factors, -2 * np.einsum("ni,in->n", factors, linear) - np.einsum("ni,nij,nj->n", factors, gram, factors)

    def _off(self, boundary: np.ndarray) -> np.ndarray:
        """(n,) how far jumps are from what is asked for, where forces may be."""
        w, = self.space.extended(self.space.trace(boundary, self.asked.known))
        off = np.einsum("kip,nip->nkp", self.carries, self.pairs.transfer.jump(w) - self.asked.jump)
        each = np.abs(off).max(axis=(1, 2), initial=0.0)
        return np.array(self.space.team.max(*each)) if len(each) else each


def directions(pairs: Pairs) -> np.ndarray:
    """(3, 3, P) up to three unit vectors [which, component, point] in which forces may act at a point; zero for none.

    Where sides that press do not feel what is asked across the normal there is the normal alone; the three axes elsewhere.
    """
    points, count = pairs.points, len(pairs)
    axes = np.repeat(np.eye(3)[:, :, None], count, axis=2) * pairs.free[:, None]
    if not count:
        return axes
    given, bonded = (np.repeat(x, np.diff(pairs.bounds)) for x in np.array([(i.law.imposed, i.law.perfect) for i in pairs.interfaces]).T)
    felt = bonded > 0  # bonds feel everything
    worth = HARD * np.where(felt, 0.0, points.stiff_n) * np.where(felt, 0.0, np.abs(given) + points.area ** 0.5)
    for axis in np.eye(3):
        across = points.across(np.repeat(axis[:, None], count, axis=1))
        asked = worth * (across - points.normal)
        for number in pairs.numbers:
            answer = pairs.force(pairs.masked(asked), History.none(count), number).force
            felt |= np.abs(points.across(answer)).max(axis=0) > CLOSED * np.abs(asked).max(axis=0)
    upright = np.zeros_like(axes)
    upright[0] = points.normal
    bare = pairs.free.all(axis=0) & ~felt
    return np.where(bare, upright, axes)
