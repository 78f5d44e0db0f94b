"""Interface forces λ̂ that obey the laws exactly and keep every body in balance.

The laws' forces f̂ = law(F) of a local stage obey the laws, but bodies that supports leave free to
move are not in balance under them. These move, as rigid bodies, until they are: with R the rigid
motions that supports leave, B the jump,

    λ̂ = law(F + keq B R y)      where      Rᵀ(f_d − NᵀBᵀλ̂) = 0.

This is the coarse contact problem of rigid bodies that are nothing but rigid, K₀ = 0, solved to
rounding, or nearly so where E is an estimate, with true laws: no springs of stabilisation. λ̂ is,
without friction, the lawful and balanced force nearest to F in the norm of keq⁻¹, y the multiplier.
Where there is no such force something pushes bodies that the true laws do not hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.laws.points import Answer
from orchestrator.method.coarse.pair_fields import PairFields
from orchestrator.method.coarse.problem import CoarseProblem, of_all
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import orthonormal
from orchestrator.method.interface.search_direction import SearchDirection
from orchestrator.scene.conditions.rigid import RIGID

BALANCED = 1e-13  # of the resultants, what rounding leaves of a balance
# The same where laws are not convex, so that E of loose bodies is an estimate, and CARRIED of what
# loads any of them: a thousand grains near
# the end of a run are there in 3 to 72 steps; the rest of the way moves grains that nothing
# presses, and takes hundreds.
NEARLY = 1e-9
TOLERATED = 100.0  # of that, what is left by another way of summing up
# of the resultants of loads, what may be left: less of them than rounding leaves would all seem
# carried
CARRIED = 1e-3
MOST = 300  # steps: bodies that nothing presses have to be in balance too
FAR = 1e6  # of the largest displacement, how far a body may be moved: no limit to speak of


@dataclass(frozen=True)
class Balanced:
    """Forces of one load step.

    answer : of the laws; its force is λ̂ (3, P)
    F : (3, P) what they were asked
    y : (bodies, 6) how far the bodies moved
    unbalanced : (bodies,) bool, those that are not in balance
    """

    answer: Answer
    F: np.ndarray
    y: np.ndarray
    unbalanced: np.ndarray


class AdmissibleForces:
    """The forces of one decomposition.

    direction : search direction
    pairs : points of all interfaces, perfect ones included, without springs
    modes : per own subdomain (boundary dofs, r ≤ 6), rigid motions that its supports leave
    """

    def __init__(self, direction: SearchDirection, pairs: Pairs, modes: list[np.ndarray]):
        self.space, self.pairs = direction.space, pairs
        space, team, k = self.space, self.space.team, direction.diagonal
        self.bodies = space.link.subdomain_count
        boundary, parts = space.side_by_side(dict(enumerate(modes)), RIGID), space.parts
        traces = space.trace(boundary)
        self.U, self.u, missing, self.R = np.zeros_like(traces), np.zeros_like(boundary), np.zeros(
            (len(parts), RIGID, RIGID)), []
        for e, (part, at) in enumerate(zip(parts, space.boundary)):
            R = orthonormal((traces[:, part] * k[part]) @ traces[:, part].T)
            self.U[:, part], self.u[:, at] = R.T @ traces[:, part], R.T @ boundary[:, at]
            self.R.append(R[: modes[e].shape[1]])
            missing[e] = np.diag(~R.any(axis=0))  # motions that a body lacks stay at rest
        everywhere, = space.extended(self.U)
        transfer = pairs.transfer
        T = np.concatenate([transfer.first(everywhere), -transfer.second(everywhere)])
        L = -pairs.points.stiffness(T)
        T, L = (np.ascontiguousarray(x.transpose(2, 1, 0)) for x in (T, L))
        self.parts, self.sizes = parts, np.abs(T)
        self.problem = CoarseProblem(team, space.subdomains,
                                     PairFields.of(pairs, T, L, self.bodies),
                                     of_all(team, self.bodies, space.subdomains, missing),
                                     [np.ascontiguousarray(self.U[:, part].T) for part in parts])
        self.problem.reduction, self.problem.most = 0.0, MOST
        self.exact = not team.max(float(not all(i.law.convex for i in pairs.interfaces)))[0]

    def __call__(self, F: np.ndarray, f: np.ndarray, before: History, number: int,
                 radius: float) -> Balanced:
        """λ̂ of one load step.

        F : (3, P) predicted forces; f : (D,) forces of the linear stage, which the loads balance
        """
        team, own = self.space.team, self.space.subdomains
        pushed = np.array([self.U[:, part] @ f[part] for part in self.parts])
        resultant = of_all(team, self.bodies, own, pushed)
        carried = np.einsum("pif,ip->f", self.sizes, np.abs(np.where(self.pairs.mine, F, 0.0)))
        everything = float(np.linalg.norm(team.sum(carried)[0]))
        rounding = BALANCED * everything
        loads = np.linalg.norm(resultant, axis=1)
        least = CARRIED * loads[loads > TOLERATED * rounding].min(initial=np.inf)
        self.problem.goal = goal = rounding if self.exact else max(
            rounding, min(NEARLY * everything, least))
        y, there = self.problem.solve(0, number, F, resultant, before,
                                      np.full(self.bodies, FAR * radius))
        answer, fields = self.pairs.force(there, before, number), self.problem.fields
        carried, = team.sum(fields.carried(answer.force, self.pairs.mine.astype(float)))
        left = np.linalg.norm(resultant - carried, axis=1)
        return Balanced(answer, there, y, left > max(goal, TOLERATED * rounding))

    def displacement(self, y: np.ndarray) -> np.ndarray:
        """(B,) R y."""
        result = np.zeros(self.u.shape[1])
        for e, part in zip(self.space.subdomains, self.space.boundary):
            result[part] = y[e] @ self.u[:, part]
        return result

    def moved(self, y: np.ndarray) -> np.ndarray:
        """(own modes,) y in the coordinates of ``modes``."""
        return np.concatenate(
            [np.zeros(0), *(R @ y[e] for e, R in zip(self.space.subdomains, self.R))])
