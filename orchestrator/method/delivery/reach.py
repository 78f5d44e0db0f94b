"""Distances that bodies may be from their places, with an error in energy that is known.

Laws may hold to a tolerance while a body that next to nothing holds is hundreds of tolerances from
its place. What holds bodies is seen as springs between rigid ones: at a pair the search direction's
own stiffness keq, which is made for the bodies behind it, in those directions in which the law
holds (``Law.carries``, ∂f̂/∂F). A pair holds by its stiffness up to the force c that it can give up
or take on before its law lets go: a pressed side its pressure, what sticks what friction leaves.
Beyond, it holds by c alone. With an error ρ in energy a field y of rigid motions is within reach if

    Σ_pairs ψ(B y) ≤ ρ²,     ψ(d) = k d²  up to k d = c,  c d beyond,

which is solved by weights: w = min(k, c/d) with d what is within reach of the pair itself, so that
H(w) = Σ Bᵀ w B, d² = ρ² B H⁻¹ Bᵀ, a few times over. A body may then be off by ρ (‖H⁻¹‖ of its
shift)^½, and the same of its turn; and deformed by ρ over the root of its nodes' mean stiffness.
Supports hold by that stiffness as well: a body that is held at a single node turns about it. A body
that H does not hold has no place. With ρ a bound all of it would be one if bodies were rigid; they
are not, and keq is a scale: it is an estimate from above, `orchestrator study places`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dpotrf, dtrtri

from orchestrator.laws.points import dot, norm
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.sparse.symmetric import factorise
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import scattered
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.bodies import JoinedBodies, RIGID
from orchestrator.scene.interface import ends_of

PASSES = 5  # in which weights follow what is within reach
FREE = 1e-10  # stiffness of a motion, over that of all pairs closed, that counts as none
PART = 1e-3  # of such a motion, from which a body has no place
DENSE, SOFT = 1500, 200  # rigid motions of which all modes are found, and how many modes of more
SWEEPS = 8  # of inverse iteration for these


def reach(d: Decomposition, bodies: JoinedBodies, iterated: Iterated,
          error: np.ndarray) -> np.ndarray:
    """(bodies, T) lengths; infinite for a body that nothing holds; ``error``: (T,) ρ, an energy
    norm.
    """
    space = d.space
    moved = space.everywhere(space.side_by_side(dict(enumerate(bodies.motions)), RIGID))
    stiffness = _per_node(d, bodies)
    result = np.zeros((bodies.count, d.steps))
    for steps, pairs, before in iterated.by_pairing():
        springs = _Springs(pairs, bodies, moved, stiffness)
        for t, held in zip(range(d.steps)[steps], _held(pairs, iterated, steps, before)):
            result[:, t] = springs(held, float(error[t]))
    return result


def _per_node(d: Decomposition, bodies: JoinedBodies) -> np.ndarray:
    """(bodies,) mean stiffness k of the nodes in a body's interfaces; where it has none, of all."""
    sums = np.zeros((2, bodies.count))
    for body, part in zip(bodies.own, d.space.parts):
        k = d.stage.direction.diagonal[part]
        sums[:, body] += k.sum(), len(k)
    total, count = bodies.team.sum(sums)[0]
    return np.where(count > 0, total / np.maximum(count, 1), total.sum() / max(count.sum(), 1))


class _Held:
    """Pairs' holds at one load step: (4, 3, P) directions, and (4, P) stiffnesses and forces c up
    to which they hold.
    """

    def __init__(self, pairs: Pairs, F: np.ndarray, before: History, number: int):
        answer, points = pairs.force(F, before, number, derivative=True), pairs.points
        self.directions = np.concatenate([points.normal[None], np.zeros((3, 3, len(pairs)))])
        self.most = np.zeros((4, len(pairs)))
        for at, carries in pairs.carries(before, number):
            force, normal = answer.force[:, at], points.normal[:, at]
            push = np.maximum(carries.side * dot(force, normal), 0.0)
            beside = norm(
                np.stack([dot(way, force - push * carries.side * normal)
                          for way in carries.directions]))
            free = np.isinf(carries.limit)
            self.directions[1:, :, at], self.most[0, at] = carries.directions, push
            self.most[1:, at] = np.where(free, np.inf,
                                         np.maximum(np.where(free, 0.0, carries.limit)
                                                    + carries.friction * push - beside, 0.0))
            for motion in carries.motions:  # what all points make freely holds nothing
                way = motion / np.where(motion.any(axis=0), norm(motion), 1.0)
                self.directions[:, :, at] -= dot(self.directions[:, :, at], way)[:, None] * way
        slope = np.zeros((3, 3, len(pairs)))
        slope[..., answer.active] = answer.derivative
        given = np.einsum("kip,ijp,kjp->kp", self.directions, slope,
                          points.stiffness(self.directions))
        self.stiffness = np.where(self.most > 0, np.maximum(given, 0.0), 0.0)


def _held(pairs: Pairs, iterated: Iterated, steps: slice, before: History) -> Iterator[_Held]:
    """Load step by load step."""
    local = iterated.local.steps(steps)
    predicted = pairs.traces(*(x[steps] for x in iterated.fields.extended)).predicted()
    for t, (F, number) in enumerate(zip(predicted, pairs.numbers)):
        yield _Held(pairs, F, before, number)
        before = History(local.jump[t], {name: x[t] for name, x in local.own.items()})


class _Springs:
    """Bodies and the pairs between them, of one pairing.

    moved : (6, D + G) what traces move in the motions of their bodies
    stiffness : (bodies,) that supports hold by, and nodes
    """

    def __init__(self, pairs: Pairs, bodies: JoinedBodies, moved: np.ndarray,
                 stiffness: np.ndarray):
        self.pairs, self.bodies, self.stiffness = pairs, bodies, stiffness
        # (12, 3, P)
        self.T = np.concatenate([pairs.transfer.first(moved), -pairs.transfer.second(moved)])
        self.ends = bodies.body[ends_of(pairs.interfaces)]
        self.supports = sp.block_diag(list(stiffness[:, None, None] * bodies.held), format="csr")
        closed = dot(self.T, pairs.points.stiffness(self.T)) * pairs.mine
        whole = np.zeros((bodies.count, RIGID))
        for ends, part in self._interfaces():
            for side, body in enumerate(ends):
                whole[body] += closed[RIGID * side: RIGID * (side + 1), part].sum(axis=1)
        whole = bodies.team.sum(whole)[0].ravel() + self.supports.diagonal()
        self.scale = 1 / np.sqrt(np.where(whole > 0, whole, 1.0))

    def __call__(self, held: _Held, error: float) -> np.ndarray:
        """(bodies,) how far each may be off."""
        along = np.einsum("kip,jip->kjp", held.directions, self.T)  # (4, 12, P)
        weight = held.stiffness
        for _ in range(PASSES):
            modes, rest, loose = self._modes(self._matrix(along, weight))
            far = error * np.sqrt(self._squares(along, modes, rest))
            weight = np.minimum(held.stiffness,
                                np.divide(held.most, far, out=np.full_like(far, np.inf),
                                          where=far > 0))
        softness = modes @ modes.swapaxes(1, 2) + rest
        shift, turn = (np.sqrt(np.linalg.eigvalsh(softness[:, part, part])[:, -1])
                       for part in (slice(0, 3), slice(3, 6)))
        return np.where(loose, np.inf, error * (shift + turn + 1 / np.sqrt(self.stiffness)))

    def _interfaces(self) -> Iterator[tuple[np.ndarray, slice]]:
        return zip(self.ends, (part for _, part in self.pairs.each()))

    def _matrix(self, along: np.ndarray, weight: np.ndarray) -> sp.csr_array:
        """H of all ranks, scaled."""
        size, mine = RIGID * self.bodies.count, np.sqrt(np.where(self.pairs.mine, weight, 0.0))
        blocks = [np.zeros((0, 2 * RIGID, 2 * RIGID))]
        for _, part in self._interfaces():
            felt = (along[..., part] * mine[:, None, part]).swapaxes(0, 1).reshape(2 * RIGID, -1)
            blocks.append((felt @ felt.T)[None])
        dof = (RIGID * self.ends[:, :, None] + np.arange(RIGID)).reshape(-1, 2 * RIGID)
        rows, columns = np.repeat(dof, 2 * RIGID, axis=1).ravel(), np.tile(dof, 2 * RIGID).ravel()
        own = sp.csr_array((np.concatenate(blocks).ravel(), (rows, columns)), shape=(size, size))
        S = sp.diags_array(self.scale)
        return S @ (sum(self.bodies.team.all_gather(own), sp.csr_array((size, size)))
                    + self.supports) @ S

    def _modes(self, matrix: sp.csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(bodies, 6, m) Y and (bodies, 6, 6) with Y Yᵀ and these on its diagonal H⁻¹, or above it;
        and (bodies,) bool, those that it
        does not hold. Rank 0's word counts."""
        team, size, found = self.bodies.team, matrix.shape[0], None
        if not team.rank:
            if size <= DENSE:
                root, loose = dpotrf((matrix - FREE * sp.eye_array(size)).toarray(), lower=True)
                found = np.linalg.eigh(matrix.toarray()) if loose else (
                    np.ones(size), dtrtri(root, lower=True)[0].T)
            else:
                found = softest_modes(matrix, SOFT)
        values, vectors = team.share(found)
        loose = np.linalg.norm(vectors[:, values <= FREE].reshape(self.bodies.count, -1),
                               axis=1) > PART
        modes = (self.scale[:, None] * vectors / np.sqrt(np.maximum(values, FREE))).reshape(
            self.bodies.count, RIGID, -1)
        # modes that were not found are no softer than the last one that was
        rest = self.scale.reshape(-1, RIGID, 1) ** 2 * np.eye(RIGID) / max(values.max(), FREE)
        return modes, rest * (size > DENSE), loose

    def _squares(self, along: np.ndarray, modes: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """(4, P) B H⁻¹ Bᵀ of the pairs in their directions."""
        result = np.zeros((4, along.shape[2]))
        for (one, two), part in self._interfaces():
            y, here = np.concatenate([modes[one], modes[two]]), along[..., part]
            softness = y @ y.T
            softness[:RIGID, :RIGID] += rest[one]
            softness[RIGID:, RIGID:] += rest[two]
            result[:, part] = (here * (softness @ here)).sum(axis=1)
        return np.maximum(result, 0.0)


def softest_modes(matrix: sp.csr_array, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count,) about the least eigenvalues of a semidefinite matrix (n, n), from above, and (n,
    count) their vectors.

    By inverse iteration of as many vectors at once: motions that nothing holds may be hundreds, all
    with the same eigenvalue, of which Lanczos' method misses some or breaks down.
    """
    n = matrix.shape[0]
    inverse = factorise(matrix + FREE * sp.eye_array(n))
    X = scattered(np.arange(n * count)).reshape(n, count)
    for _ in range(SWEEPS):
        X = np.linalg.qr(inverse(X.T).T)[0]
    values, turned = np.linalg.eigh(X.T @ (matrix @ X))
    return values, X @ turned
