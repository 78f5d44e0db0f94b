"""Bodies, what joining laws make of subdomains, and the rigid motions that supports leave them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.loading import bodies_of
from orchestrator.scene.conditions.rigid import motions_about, RIGID
from orchestrator.scene.interface import Interface
from orchestrator.scene.mesh.geometry import unit

# eigenvalue of a body's supports, over the largest, that holds a motion no longer: a millionth of
# it moves
FREE = 1e-12


class JoinedBodies:
    """The bodies of one decomposition, the same on all ranks.

    joins : whether an interface makes one body of both sides
    grounds : whether what grounds keep bodies from counts as held, too

    count, names : of the bodies; of what is joined, the first one's name
    body : (subdomains,) int, the body of each; own : of this rank's subdomains
    size, centre : (count,) half the diagonal of the box around each, and (count, 3) its middle
    motions : per own subdomain (boundary dofs, 6) of the body's translations, and of its rotations
        about the centre over its size
    gram : (count, 6, 6) products of these over all boundary dofs
    held : (count, 6, 6) the same over the dofs that supports hold, and over what grounds keep
    loose : (count, 6, 6) combinations of the motions that supports leave; zero columns for the
        others
    """

    def __init__(self, d: Decomposition, joins: Callable[[Interface], bool], grounds: bool = False):
        self.team, self.boundary = d.space.team, d.space.boundary
        subdomains, nodes = d.scene.subdomains, d.scene.mesh.nodes
        self.count, self.body = bodies_of(d.scene, joins)
        self.own = self.body[d.space.subdomains]
        self.names = [next(s.body for s, b in zip(subdomains, self.body) if b == body)
                      for body in range(self.count)]
        low, high = np.full((self.count, 3), np.inf), np.full((self.count, 3), -np.inf)
        for s, body in zip(d.own, self.own):
            x = nodes[s.nodes]
            low[body] = np.minimum(low[body], x.min(axis=0))
            high[body] = np.maximum(high[body], x.max(axis=0))
        ends = np.reshape(self.team.max(*-low.ravel(), *high.ravel()), (2, self.count, 3))
        low, high = -ends[0], ends[1]
        self.size, self.centre = np.linalg.norm(high - low, axis=1) / 2, (low + high) / 2
        self.motions: list[np.ndarray] = []
        self.gram, held = np.zeros((2, self.count, RIGID, RIGID))
        for s, body, part in zip(d.own, self.own, self.boundary):
            dof, fixed = d.space.global_dof[part], np.flatnonzero(s.fixed)
            moved = self.of(body, nodes[dof // 3])[np.arange(len(dof)), dof % 3]
            self.motions.append(moved)
            self.gram[body] += moved.T @ moved
            rows = self.of(body, nodes[s.nodes[fixed // 3]])[np.arange(len(fixed)), fixed % 3]
            held[body] += rows.T @ rows
        for i in d.scene.interfaces:
            if grounds and i.ground and i.subdomains[0] in d.space.subdomains:
                body = self.body[i.subdomains[0]]
                # amounts of motions have other units than nodes
                rows = unit(i.law.keeps(self.of(body, d.scene.points(i))))
                held[body] += rows.T @ rows
        self.gram, self.held = self.team.sum(self.gram, held)
        values, vectors = np.linalg.eigh(self.held)
        self.loose = vectors * (values <= FREE * values[:, -1:])[:, None, :]

    def of(self, body: int, points: np.ndarray) -> np.ndarray:
        """(n, 3, 6) a body's motions at points (n, 3)."""
        return motions_about(points, self.centre[body], self.size[body])
