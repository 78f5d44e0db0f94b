"""Bodies that bend: the coarse contact problem moves them in their own softest modes, not in affine
fields.

A body's fields serve the coarse problem where its soles hold them and the body itself does not, S x
= σ k x with σ small beside one: a stage damps what else there is by |1 − σ|/(1 + σ). Rigid motions
and mean strains are the softest fields of compact bodies. A slender body, an open ring, a thin wall
has many more, and where supports hold it none of them is affine: a clamped beam's translations have
a large part of stiff fields. Two clamped beams of L/h = 20 take 130 iterations to a law residual of
1e-4 with affine fields, 50 to 90 with their soft modes beside these, 18 with the modes alone.

Which bodies these are is measured (``BesideAffine``): fields found there are no softer than the
softest there is. Their modes come from ``soft_modes``, which the macro problem has as well.

What bodies resist beside their affine fields, as their soles see it: the ends of σ in S x = σ k x,
asked of the black box.

    C k = N M⁻¹ Nᵀ k = (S + k)⁻¹ k,    whose eigenvalues are θ = 1/(1 + σ)

A few steps of Lanczos' method in the inner product of k, all bodies side by side, each a back-
substitution per body, on what is orthogonal to affine fields. σ found so lie between the true ends.
"""

from __future__ import annotations

import numpy as np

from orchestrator.kept import kept_by
from orchestrator.method.interface.rows import DEPENDENT, orthonormal
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.answers import GuardedTraces
from orchestrator.method.linear.soft_modes import soft_modes, Wanted
from orchestrator.scene.model import Scene


class BesideAffine:
    """The bodies' fields beside the affine ones.

    on : (D,) 0 or 1, the traces that are looked at
    x : (B, 3) where boundary dofs are, from the middle of their body's, over half its extent
    U, V : (12, D) affine fields there, orthonormal in k, and k U
    """

    def __init__(self, scene: Scene, blackbox: GuardedTraces, on: np.ndarray):
        self.blackbox, self.on = blackbox, on
        self.of, self.space = blackbox.owned, blackbox.direction.space
        self.x, component = _within(scene, self.space), self.space.global_dof % 3
        fields, at = np.zeros((12, len(component))), np.arange(len(component))
        for m, monomial in enumerate([np.ones(len(self.x)), *self.x.T]):
            fields[3 * m + component, at] = monomial
        self.U = on * self.space.trace(fields)
        self.V = blackbox.direction.times(self.U)
        for part in self.of.slices:
            turn = orthonormal(self.U[:, part] @ self.V[:, part].T).T
            self.U[:, part], self.V[:, part] = turn @ self.U[:, part], turn @ self.V[:, part]

    def rough(self) -> np.ndarray:
        """(B,) a displacement that depends on where nodes are in their body alone, and is as rough
        as the mesh: waves that no mesh
        resolves, numbers at random, but the same ones for whoever asks."""
        component, held = self.space.global_dof % 3, self.space.loads(
            self.on * self.blackbox.direction.diagonal[None])[0]
        phase = np.array([[7919.0, 6101.0, 4801.0], [5869.0, 7687.0, 5303.0],
                          [6637.0, 4441.0, 7207.0]])[component]
        return np.cos(np.sum(phase * self.x, axis=1)) / np.sqrt(np.where(held > 0, held, 1.0))

    def bent(self) -> np.ndarray:
        """(B,) a displacement of second degree in the coordinates, with a part of all that there
        are: what is slender or thin
        bends and twists about so."""
        component, x = self.space.global_dof % 3, self.x.copy()
        for part in self.space.boundary:
            x[part] /= np.maximum(np.abs(x[part]).max(axis=0, initial=0.0), np.finfo(float).tiny)
        degrees = np.stack(
            [x[:, i] * x[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))])
        # numbers of either sign, of which none is the other
        shares = np.cos(1 + 2.4 * np.arange(18)).reshape(6, 3)
        return np.sum(shares[:, component] * degrees, axis=0)

    def ends(self, start: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """(S,) bool, of each body with traces whether it has anything beside affine fields, and (n,
        2) least and largest σ
        of those that have.

        start : (B,) displacement to start from
        """
        of, space, product = self.of, self.space, lambda v: self.blackbox.direction.times(v[None])[
            0]
        start = self.on * space.trace(start[None])[0]
        beside = self._rest(start)
        before, left = (of.sums(v * product(v)) for v in (start, beside))
        exists = left > DEPENDENT * before
        theta = of.lanczos(np.where(of.spread(exists), beside, 0.0), product,
                           lambda kv: self._rest(self.on
                                                 * self.blackbox.answered(space.loads(kv[None]))[1][
                                                     0]), steps)
        tiny = np.finfo(float).eps
        return exists, np.maximum(1 / np.maximum(np.linalg.eigvalsh(theta[exists])[:, [-1, 0]],
                                                 tiny) - 1, tiny)

    def _rest(self, v: np.ndarray) -> np.ndarray:
        """(D,) v without affine fields."""
        return v - np.sum(self.U * self.of.spread(self.of.sums(self.V * v)), axis=0)


def _within(scene: Scene, space: TraceSpace) -> np.ndarray:
    """``BesideAffine.x``."""
    x, result = scene.mesh.nodes[space.global_dof // 3], np.zeros((len(space.global_dof), 3))
    for part in space.boundary:
        if part.stop > part.start:
            low, high = x[part].min(axis=0), x[part].max(axis=0)
            result[part] = (x[part] - (low + high)
                            / 2) / max(np.max(high - low) / 2, np.finfo(float).tiny)
    return result


STEPS = 4  # of Lanczos' method from a bent field, each a back-substitution per body
# σ found so, from above, below which a body is worth its modes, for about a hundred
# back-substitutions. It tells how many iterations
# to 1e-4 two clamped beams take with affine fields, whatever their L/h and mesh: .145 19, .094 24,
# .07 30, .064 41, .05 46, .044 57, .038 68.
FOUND = 0.07
# No fewer fields than affine ones are. What is left of stiffer fields in a mode costs iterations:
# with residuals of .02 and of .005, beams
# of L/h = 20 and 40 take 24 and 18, 27 and 18, for 8 to 24 back-substitutions more. Beams of
# ten-node tets with L/h = 40 need 370.
MODES = Wanted(least=12, accurate=0.005, largest=640)


@kept_by(lambda scene, blackbox: [blackbox, scene.stand_ins, [
    (i.subdomains, i.law.perfect) for i in scene.interfaces]])
def soft_bodies(scene: Scene, blackbox: GuardedTraces) -> tuple[dict[int, np.ndarray], float]:
    """Soft modes of bodies that have softer fields than affine ones.

    blackbox : solver and search direction

    modes : place among the rank's ``space.subdomains`` → (t, m) displacements of its boundary dofs,
        orthonormal in k
    sweeps : back-substitutions per subdomain, the mean
    Raises BlackBoxError: from the code
    """
    space, of = blackbox.direction.space, blackbox.owned
    bodies = BesideAffine(scene, blackbox, np.ones(space.size))
    known, ends = bodies.ends(bodies.bent(), STEPS)
    parts = np.array([e for i in scene.interfaces if not i.law.perfect for e in i.subdomains],
                     dtype=int)
    wanted = np.zeros(len(scene.subdomains), dtype=bool)
    wanted[np.array(space.subdomains, dtype=int)[of.subdomains[known][ends[:, 0] < FOUND]]] = True
    # a tool's layer has a back that does not bend
    wanted &= np.isin(np.arange(len(wanted)), parts) & ~scene.stand_ins
    modes, sweeps = soft_modes(blackbox.direction, blackbox, wanted, MODES)
    return modes, STEPS + sweeps
