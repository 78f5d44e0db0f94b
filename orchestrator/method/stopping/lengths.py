"""How long displacements are that mean something: the scale of the laws' residuals.

It comes from what is loaded and held, and from how far bodies are deformed, never from where a loose body is: that is
undetermined, as far away as it likes, and whatever is measured relative to it is small. A body is what joining laws
make one; its displacement is split in the rigid motion that its supports prescribe, a rigid motion that they leave, and

- the deformation, the largest displacement of a boundary node that is left;
- what the scene was told: per body its largest prescribed displacement and what its loads alone move it on its soles,
  M⁻¹f_ext (with what its supports strain), per interface what its law imposes (a press fit, a jump). The smallest counts, so that a body sent far away
  says nothing of the others. It matters where next to nothing is deformed, as where all contacts are open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import components

FREE = 1e-12  # eigenvalue of a body's supports, over the largest, that holds a motion no longer: a millionth of it moves
ROUNDING = 1e-12  # of the largest length that a scene was told, what counts as none
# Forces are differences of k u: below this share of it they count as none, as where all contacts are open.
REST = 1e-4
RIGID = 6


@dataclass(frozen=True)
class Lengths:
    """What displacements are compared with.

    deformation : largest displacement beside rigid motions
    told : by the loads, supports and laws
    rigid : (bodies, T, 6) rigid motion of each body that its supports leave: of its centre, and its rotation times its
        size, half the diagonal of the box around it
    """

    deformation: float
    told: float
    rigid: np.ndarray

    @property
    def of_displacements(self) -> float:
        """What lengths are divided by."""
        return max(self.deformation, REST * self.told) or 1.0

    @property
    def of_rest(self) -> float:
        """What stiffnesses are multiplied with for forces that count as none."""
        return REST * max(self.deformation, self.told)


class LengthScale:
    """The lengths of one decomposition, for some or all of its load steps.

    count, size, names : of the bodies; of what is joined, the first one's name
    body : (subdomains,) int, the body of each

    """

    def __init__(self, d: Decomposition):
        self.team, self.boundary = d.space.team, d.space.boundary
        subdomains, nodes = d.scene.subdomains, d.scene.mesh.nodes
        joined = np.array([i.subdomains for i in d.scene.interfaces if i.law.joins]).reshape(-1, 2)
        self.count, self.body = components(*joined.T, len(subdomains))
        self.own = self.body[d.space.subdomains]
        self.names = [next(s.body for s, b in zip(subdomains, self.body) if b == body) for body in range(self.count)]
        low, high = np.full((self.count, 3), np.inf), np.full((self.count, 3), -np.inf)
        for s, body in zip(d.own, self.own):
            x = nodes[s.nodes]
            low[body], high[body] = np.minimum(low[body], x.min(axis=0)), np.maximum(high[body], x.max(axis=0))
        ends = np.reshape(self.team.max(*-low.ravel(), *high.ravel()), (2, self.count, 3))
        low, high = -ends[0], ends[1]
        self.size = np.linalg.norm(high - low, axis=1) / 2
        self._held(d, (low + high) / 2)
        told = np.zeros((2, self.count))
        for body, part, lift in zip(self.own, self.boundary, d.loading.lift):
            for kind, values in enumerate((lift, d.loading.working[:, part])):  # and what strains its supports: rigid motions are none
                told[kind, body] = max(told[kind, body], np.abs(values).max(initial=0.0))
        told = np.concatenate([self.team.max(*told.ravel()), [i.law.imposed for i in d.scene.interfaces]])
        told = told[told > ROUNDING * told.max(initial=0.0)]
        self.told = float(told.min(initial=np.inf)) if len(told) else 0.0

    def _held(self, d: Decomposition, centre: np.ndarray) -> None:
        """Find the motions that supports prescribe (``prescribed``: bodies, T, 6) and those that they leave; ``fit`` (bodies, 6, 6)
        makes of products with the motions the free ones that fit best. Bodies turn about their centres (bodies, 3)."""
        self.motions: list[np.ndarray] = []
        gram, held = np.zeros((2, self.count, RIGID, RIGID))
        moved, at_supports, nodes = np.zeros((self.count, d.steps, RIGID)), [], d.scene.mesh.nodes
        for s, body, part, lift in zip(d.own, self.own, self.boundary, d.loading.lift):
            about, dof = (centre[body], self.size[body]), d.space.global_dof[part]
            self.motions.append(motions_about(nodes[dof // 3], *about)[np.arange(len(dof)), dof % 3])
            gram[body] += self.motions[-1].T @ self.motions[-1]
            fixed = np.flatnonzero(s.fixed)
            rows = motions_about(nodes[s.nodes[fixed // 3]], *about)[np.arange(len(fixed)), fixed % 3]
            held[body] += rows.T @ rows
            moved[body] += lift[:, fixed] @ rows
            at_supports.append((rows, lift[:, fixed]))
        gram, held, moved = self.team.sum(gram, held, moved)
        values, vectors = np.linalg.eigh(held)
        free = values <= FREE * values[:, -1:]
        turned = vectors.swapaxes(1, 2) @ moved.swapaxes(1, 2)
        inverse = np.where(free, 0.0, 1 / np.where(free, 1.0, values))
        self.prescribed = (vectors @ (inverse[:, :, None] * turned)).swapaxes(1, 2)
        loose = vectors * free[:, None, :]
        gram = np.linalg.pinv(loose.swapaxes(1, 2) @ gram @ loose, rcond=FREE, hermitian=True)
        self.fit = loose @ gram @ loose.swapaxes(1, 2)
        self.strained = max((np.abs(lift - self.prescribed[body] @ rows.T).max(initial=0.0)
                             for body, (rows, lift) in zip(self.own, at_supports)), default=0.0)

    def __call__(self, u: np.ndarray) -> Lengths:
        """The lengths for displacements (T, B) of the boundary dofs."""
        apart = [u[:, part] - self.prescribed[body] @ rows.T for body, part, rows in zip(self.own, self.boundary, self.motions)]
        products = np.zeros((len(self.fit), len(u), RIGID))
        for body, rows, left in zip(self.own, self.motions, apart):
            products[body] += left @ rows
        loose = self.team.sum(products)[0] @ self.fit
        largest = max((np.abs(left - loose[body] @ rows.T).max(initial=0.0)
                       for body, rows, left in zip(self.own, self.motions, apart)), default=0.0)
        deformation, = self.team.max(np.maximum(largest, self.strained))  # nan stays
        return Lengths(deformation, self.told, loose)
