"""Nonlinear coarse correction: every body moves in its affine fields under the true contact laws.

The slow tail of the fixed point is the motion of whole bodies against each other. It is removed by
a small contact problem solved after every linear stage: each subdomain's state may change by
s += V y with 12 affine fields, whose response is known from set-up,

    U = N R,   V = k U,   W = N M⁻¹NᵀV,   F = V − k W

and y makes the forces agree with the laws on these fields, load step after load step:

    ρ(y) = Uᵀ(f + F y) − Σ_pairs Tᵀ law(F₀ + L y) = 0,     T = [U₁, −U₂]
    L = [½F₁ − keq W₁, −½F₂ + keq W₂],   F₀ as in the local stage

by a semismooth Newton with a Levenberg term, which is what makes it robust. U is made orthonormal in k. It costs no
back-substitution per iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.block_pattern import BlockPattern
from orchestrator.method.contact_stage import ContactStage
from orchestrator.method.linear_stage import Admissible, LinearStage
from orchestrator.method.pairs import Pairs
from orchestrator.scene.model import Scene

FIELDS = 12
REDUCTION = 1e-2  # a coarse problem need not be solved better than the iteration it serves
SERVED, SLOW, IDLE = 0.1, 0.9, 2  # reduced this much, a solve ends after two steps that gain less than a tenth
MAX_STEPS = 12
FLAT = 1.001  # growth of ρ that still counts as standing still
LEVENBERG = 1e-4  # first shift of the Newton matrix, relative to k; raised where a step fails
DEPENDENT = 1e-10  # eigenvalue of the fields' Gram matrix, over the largest, that counts as zero
REACH = 0.3  # longest move of a body in one Newton step, over the largest displacement at the start


@dataclass
class _Response:
    """Per trace dof (D, 12): fields of the owner's body and their response."""

    U: np.ndarray
    V: np.ndarray
    W: np.ndarray
    F: np.ndarray


class CoarseCorrection:
    """The coarse contact problem of one decomposition.

    Parameters
    ----------
    scene : for the coordinates
    stage : linear stage; solves the 12 fields of every body once
    pairs : node pairs of all interfaces, perfect ones included

    Attributes
    ----------
    sweeps : back-substitutions per subdomain at set-up
    newton_steps : Newton steps taken so far

    Notes
    -----
    Among ranks, what belongs to a body is formed by its rank, what belongs to an interface by the rank of its first
    side. ρ is summed, every Newton matrix goes to rank 0, which solves for all: right for some thousands of bodies.
    """

    sweeps = FIELDS

    def __init__(self, scene: Scene, stage: LinearStage, pairs: Pairs):
        self.stage, self.pairs = stage, pairs
        self.predict = ContactStage(stage.direction, pairs)
        space = stage.space
        self.team = space.team
        self.bodies, self.own = len(scene.subdomains), space.subdomains
        own = space.owner[: space.size]
        self.parts = [slice(*(int(np.searchsorted(own, e, side)) for side in ("left", "right"))) for e in self.own]
        k = stage.direction.k
        U = self._orthonormal(self._fields(scene), k)
        V = k @ U
        self.boundary_response = stage.solve(space.scatter @ V)  # subdomains do not see each other's columns
        W = space.trace(self.boundary_response)
        self.response = _Response(U, V, W, V - k @ W)
        K0 = self._per_body(U, self.response.F)
        dropped = np.array([~U[part].any(axis=0) for part in self.parts])
        K0[:, np.arange(FIELDS), np.arange(FIELDS)] += dropped  # fields a body lacks stay at rest
        self.K0 = self._of_all(K0)

        one, two, free = pairs.one, pairs.two, pairs.free[:, :, None]
        points = pairs.points
        U, W, F = space.extended(U, W, self.response.F)

        def keq(x):  # (P, 3, 12)
            along = np.einsum("pif,pi->pf", x, points.normal)
            return points.stiff_t[:, None, None] * x + (
                (points.stiff_n - points.stiff_t)[:, None] * along)[:, None, :] * points.normal[:, :, None]

        # (P, 3, 24): the fields of the first body, then of the second
        self.T = np.where(free, np.concatenate([U[one], -U[two]], axis=2), 0.0)
        self.L = np.where(free, np.concatenate([0.5 * F[one] - keq(np.where(free, W[one], 0.0)),
                                                -0.5 * F[two] + keq(np.where(free, W[two], 0.0))], axis=2), 0.0)
        self.counts, self.ends = np.diff(pairs.bounds), 3 * pairs.bounds
        self.firsts, self.seconds = np.array([i.subdomains for i in pairs.interfaces], dtype=int).reshape(-1, 2).T
        self.counted = np.flatnonzero(np.isin(self.firsts, self.own))  # interfaces that this rank adds up
        # a Newton matrix need not be more accurate than the step it is good for
        self.T_single, self.L_single = self.T.astype(np.float32), self.L.astype(np.float32)
        counted = [pairs.interfaces[i] for i in self.counted]
        everyones = sum(self.team.all_gather([(i.law, i.index) for i in counted]), [])
        # the order in which blocks are added must not depend on the ranks: single precision shows it
        self.order = np.array(sorted(range(len(everyones)), key=everyones.__getitem__), dtype=int)
        ends = np.array([scene.interfaces[everyones[i][1]].subdomains for i in self.order]).reshape(-1, 2)
        self.pattern = BlockPattern(ends, self.bodies, FIELDS) if self.team.rank == 0 else None
        self.newton_steps = 0
        self.prescribed = max(np.abs(s.prescribed).max(initial=0.0) for s in scene.subdomains)
        self.radius: float | None = None

    def start_from(self, local: ContactStage) -> None:
        """Take over the jumps that a local stage starts from; perfect interfaces have none."""
        previous = np.zeros((len(self.pairs), 3))
        begin = {i.index: a for i, a in zip(self.pairs.interfaces, self.pairs.bounds)}
        for i, a, b in zip(local.pairs.interfaces, local.pairs.bounds[:-1], local.pairs.bounds[1:]):
            previous[begin[i.index] : begin[i.index] + b - a] = local.previous[a:b]
        self.predict = ContactStage(self.stage.direction, self.pairs, previous)

    def __call__(self, fields: Admissible) -> Admissible:
        """Corrected admissible fields.

        Parameters
        ----------
        fields : result of a linear stage
        """
        steps = fields.s.shape[1]
        if self.radius is None:
            self.radius = REACH * max(self.team.max(np.abs(fields.w).max(initial=0.0))[0], self.prescribed)
        y = np.zeros((steps, self.bodies, FIELDS))
        resultant = self._of_all(self._resultants(fields.f)).swapaxes(0, 1)
        previous = self.predict.previous
        w, f = self.stage.space.extended(fields.w, fields.f)
        for t in range(steps):
            F0 = self.predict.predicted(w[:, t], f[:, t])
            y[t], F = self._solve(F0, resultant[t], previous)
            previous = self.predict.jump(F, self.pairs.force(F, previous).force)
        s, w, f, u = fields.s.copy(), fields.w.copy(), fields.f.copy(), fields.u.copy()
        r = self.response
        for e, part, boundary in zip(self.own, self.parts, self.stage.space.boundary):
            change = y[:, e].T
            s[part] += r.V[part] @ change
            w[part] += r.W[part] @ change
            f[part] += r.F[part] @ change
            u[boundary] += self.boundary_response[boundary] @ change
        return Admissible(s, u, fields.alpha, w, f)

    def _solve(self, F0: np.ndarray, resultant: np.ndarray,
               previous: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(bodies, 12) y of one load step, and (P, 3) F = F₀ + L y."""
        y = np.zeros((self.bodies, FIELDS))
        delta, matrix = LEVENBERG, None
        F = F0
        rho = self._residual(y, F, resultant, previous)
        size = start = np.linalg.norm(rho)
        idling, before = 0, np.inf
        for _ in range(MAX_STEPS):
            idling, before = (idling + 1 if size > SLOW * before else 0), size
            if size <= REDUCTION * start or size == 0 or (idling == IDLE and size <= SERVED * start):
                break
            self.newton_steps += 1
            if matrix is None:
                matrix = self._matrix(F, previous)
            dy = self._clipped(self.team.share(-self.pattern.solve(matrix, rho, delta) if self.pattern else None))
            dF = self._spread(dy)
            for theta in (1.0, 0.5, 0.25):
                trial, F_new = y + theta * dy, F + theta * dF
                rho_new = self._residual(trial, F_new, resultant, previous)
                size_new = np.linalg.norm(rho_new)
                # a loose body feels nothing until it touches: once the shift is raised, standing still is allowed
                idle = theta == 1 and delta > LEVENBERG and size_new <= FLAT * size
                if size_new <= (1 - 0.2 * theta) * size or idle:
                    y, F, rho, size, matrix = trial, F_new, rho_new, size_new, None
                    break
            else:
                delta *= 30
                if delta > 1e3:
                    break
        return y, F

    def _clipped(self, dy: np.ndarray) -> np.ndarray:
        """A body that nothing touches has no stiffness to stop it: no step moves a body by more than the radius."""
        move = self._of_all(np.array([np.abs(self.response.W[part] @ dy[e]).max(initial=0.0)
                                      for e, part in zip(self.own, self.parts)]))
        return dy * (self.radius / np.maximum(move, self.radius))[:, None]

    def _residual(self, y: np.ndarray, F: np.ndarray, resultant: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """(bodies, 12) ρ, for F = F₀ + L y."""
        force = self.pairs.force(F, previous).force
        flat, T, ends = force.ravel(), self.T.reshape(-1, 2 * FIELDS), self.ends
        sums = np.array([flat[ends[i] : ends[i + 1]] @ T[ends[i] : ends[i + 1]] for i in self.counted])
        sums = sums.reshape(-1, 2, FIELDS)
        carried = np.zeros((self.bodies, FIELDS))
        np.add.at(carried, self.firsts[self.counted], sums[:, 0])
        np.add.at(carried, self.seconds[self.counted], sums[:, 1])
        carried, = self.team.sum(carried)
        return resultant + np.einsum("bij,bj->bi", self.K0, y) - carried

    def _spread(self, y: np.ndarray) -> np.ndarray:
        """(P, 3) L y."""
        both = np.concatenate([y[self.firsts], y[self.seconds]], axis=1)
        L = self.L.reshape(-1, 2 * FIELDS)
        if not len(L):
            return np.zeros((0, 3))
        return np.concatenate([L[a:b] @ v for a, b, v in zip(self.ends[:-1], self.ends[1:], both)]).reshape(-1, 3)

    def _matrix(self, F: np.ndarray, previous: np.ndarray) -> np.ndarray | bool:
        """Values of K₀ − ΣTᵀA L, for ``pattern``, where that is; only pairs that carry a force contribute."""
        answer = self.pairs.force(F, previous, derivative=True)
        active = answer.active
        T = self.T_single[active].reshape(-1, 2 * FIELDS)
        AL = (answer.derivative.astype(np.float32) @ self.L_single[active]).reshape(-1, 2 * FIELDS)
        ends = 3 * np.searchsorted(active, self.pairs.bounds)
        blocks = np.zeros((len(self.counted), 2 * FIELDS, 2 * FIELDS), np.float32)
        for block, a, b in zip(blocks, ends[self.counted], ends[self.counted + 1]):
            if b > a:
                np.matmul(T[a:b].T, AL[a:b], out=block)
        everyone = self.team.gather(blocks)
        return self.pattern.values(-np.concatenate(everyone)[self.order], self.K0) if everyone else False

    def _fields(self, scene: Scene) -> np.ndarray:
        """(D, 12) affine fields of the owner's body; tied dofs stay at rest, so that contact pairs do all the work."""
        space = self.stage.space
        fields = space.trace(_affine_fields(scene, space))
        if space.ties is not None:
            fields[space.ties.dofs] = 0.0
        return fields

    def _orthonormal(self, fields: np.ndarray, k) -> np.ndarray:
        """(D, 12) the same span per body with UᵀkU = 1; what is dependent becomes zero.

        On a body that has a single plane interface, the gradients along its normal are.
        """
        result = np.zeros_like(fields)
        for part, gram in zip(self.parts, self._per_body(fields, k @ fields)):
            size, vectors = np.linalg.eigh(gram)
            keep = size > DEPENDENT * size.max(initial=0.0)
            result[part][:, keep] = fields[part] @ (vectors[:, keep] / np.sqrt(size[keep]))
        return result

    def _per_body(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(own bodies, 12, 12) aᵀb over each body's trace dofs, which lie together."""
        result = np.zeros((len(self.own), FIELDS, FIELDS))
        for e, part in enumerate(self.parts):
            result[e] = a[part].T @ b[part]
        return result

    def _resultants(self, f: np.ndarray) -> np.ndarray:
        """(own bodies, T, 12) Uᵀf."""
        return np.stack([f[part].T @ self.response.U[part] for part in self.parts])

    def _of_all(self, own: np.ndarray) -> np.ndarray:
        """(bodies, …) from what each rank knows of its own bodies."""
        everything = np.zeros((self.bodies, *own.shape[1:]))
        everything[self.own] = own
        return self.team.sum(everything)[0]


def _affine_fields(scene: Scene, space) -> np.ndarray:
    """(B, 12) translations, and gradients about the body's centre scaled by its size, per boundary dof."""
    fields = np.zeros((len(space.global_dof), FIELDS))
    for part in space.boundary:
        dof = space.global_dof[part]
        if not len(dof):
            continue
        x = scene.mesh.nodes[dof // 3]
        x = x - (x.min(axis=0) + x.max(axis=0)) / 2
        monomials = np.column_stack([np.ones(len(x)), x / max(np.abs(x).max(), np.finfo(float).tiny)])
        component = dof % 3
        for c in range(3):
            rows = component == c
            block = np.zeros((rows.sum(), FIELDS))
            block[:, c::3] = monomials[rows]
            fields[np.flatnonzero(rows) + part.start] = block
    return fields
