"""Bodies, what joining laws make of subdomains, and the rigid motions that supports leave them.

How well forces in equilibrium obey the laws at each body, beside the forces on that body.

Of all bodies together the largest forces decide: a joint that carries a thousandth of another one
may be off by all it carries. Here what the stages differ by at the interfaces of some bodies is
compared with what they carry there,

    max_g ‖f − f̂‖_g / ‖f‖_g,     in the norm of (k⁺)⁻¹, over all load steps,

where forces that displacements of the length of rest are worth count as none. What supports hold,
with all that is joined to it, is judged for itself; what contact alone holds together with the
loose bodies that it touches: what one grain among others carries may be as little as it likes, and
then tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.pairs import History, Pairs
from orchestrator.method.interface.rows import peak, ratio, times
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.linear.loading import bodies_of
from orchestrator.method.local_stage import LocalState
from orchestrator.scene.conditions.rigid import motions_about, RIGID
from orchestrator.scene.interface import ends_of, Interface
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import unit
from orchestrator.scene.model import Scene

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


def judged_together(scene: Scene, bodies: JoinedBodies) -> np.ndarray:
    """(subdomains,) int, the group of each."""
    ends = bodies.body[ends_of(scene.interfaces)]
    touching = ends[bodies.loose.any(axis=(1, 2))[ends].all(axis=1)]
    return components(*touching.T, bodies.count)[1][bodies.body]


def body_residual(parts: Sequence[tuple[Pairs, np.ndarray, np.ndarray, LocalState, History]],
                  rest: float, space: TraceSpace, groups: np.ndarray) -> float:
    """Return the largest of all groups.

    parts : as for ``law_residuals``; rest : ``Lengths.of_rest``
    groups : (subdomains,) int, of ``judged_together``
    """
    squares = np.zeros((3, space.size))
    for pairs, _, f, local, _ in parts:
        C = pairs.nodes.compliance[: space.size, : space.size]
        missing, force = (f - pairs.transfer.opposed(local.force))[:, : space.size], f[
            :, : space.size]
        softness = C.diagonal()
        stiffness = ratio(1 / 3, softness)  # as in the mean direction of a node
        squares += (missing * times(C, missing)).sum(axis=0), (force * times(C, force)).sum(
            axis=0), stiffness / len(parts)
    sums = np.zeros((3, int(groups.max(initial=-1)) + 1))
    for group, part in zip(groups[space.subdomains], space.parts):
        sums[:, group] += squares[:, part].sum(axis=1)
    off, carried, stiff = space.team.sum(sums)[0]
    scale = np.maximum(carried, stiff * rest**2)
    return float(np.sqrt(peak(ratio(off, scale))))
