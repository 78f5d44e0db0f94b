"""Which bodies the supports hold at each load step, through interfaces that are closed there.

A body is what joining laws make one. A *detached* body has no way to a prescribed one over node pairs that hold;
a *weakly held* one has, but could still move as a rigid body without opening a pair that is kept closed or sliding
where the sides are kept from it. Where both are, the laws do not say: stabilisation does, if there is any. What a status holds, it declares: contact
holds nothing where the sides touch without pressing.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.laws.status import Hold, Status, table
from orchestrator.scene.model import Scene
from orchestrator.scene.conditions.rigid import motions

MOST_BODIES = 300  # beyond, the search for weakly held ones costs more than it tells
PRESSING = 1e-6  # pressure or tension relative to the largest of all steps, from which it counts
FREE = 1e-10  # stiffness of a motion, relative to the largest, that counts as none


def held_bodies(scene: Scene, interfaces: InterfaceFields) -> tuple[list[list[str]], list[list[str]]]:
    """Names of the detached and of the weakly held bodies (of all that are joined to one), per load step."""
    count = len(scene.subdomains)
    joined = np.array([i.subdomains for i in scene.interfaces if i.law.joins]).reshape(-1, 2)
    bodies, body = _groups(count, joined)
    fixed = np.zeros(bodies, bool)
    fixed[body[[s.fixed.any() for s in scene.subdomains]]] = True
    ends = body[interfaces.subdomains]
    motion = _Motions(scene, interfaces, body) if bodies <= MOST_BODIES else None
    detached, weak = [], []
    for normal, tangential in zip(*_holding(interfaces, table(i.law for i in scene.interfaces))):
        touching = ends[np.logical_or.reduceat(normal | tangential, interfaces.offsets[:-1])]
        _, group = _groups(bodies, touching)
        lost = ~np.isin(group, group[fixed])
        loose = motion.free(normal, tangential) & ~lost if motion else np.zeros(bodies, bool)
        for result, chosen in ((detached, lost), (weak, loose)):
            result.append(list(dict.fromkeys(s.body for s, b in zip(scene.subdomains, body) if chosen[b])))
    return detached, weak


def _holding(interfaces: InterfaceFields, statuses: list[Status]) -> tuple[np.ndarray, np.ndarray]:
    """(T, N) bool twice: where the sides are kept from moving along the normal, and across it."""
    pressure, least = interfaces.pressure, PRESSING * np.abs(interfaces.pressure).max(initial=0.0)
    when = {Hold.NEVER: np.zeros(pressure.shape, bool), Hold.ALWAYS: np.ones(pressure.shape, bool),
            Hold.PRESSED: pressure > least, Hold.PULLED: pressure < -least}
    which = np.searchsorted(statuses, interfaces.status)
    return tuple(np.choose(which, [when[getattr(s, way)] for s in statuses]) for way in ("normal", "tangential"))


def _groups(count: int, edges: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of connected groups and the group (count,) of each vertex."""
    graph = sp.csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return sp.csgraph.connected_components(graph, directed=False)


class _Motions:
    """Rigid motions of all bodies, six each, and what supports and closed pairs make of them.

    Parameters
    ----------
    body : (subdomains,) int, the body of each
    """

    def __init__(self, scene: Scene, interfaces: InterfaceFields, body: np.ndarray):
        self.interfaces, self.bodies = interfaces, int(body.max()) + 1
        self.sides = body[interfaces.subdomains][interfaces.interface_of_node]  # (N, 2)
        self.columns = np.zeros((2, len(interfaces.nodes), 3, 6))
        self.support = np.zeros((self.bodies, 6, 6))
        for b in range(self.bodies):
            mine = [s for s, owner in zip(scene.subdomains, body) if owner == b]
            nodes = np.unique(np.concatenate([s.nodes for s in mine]))
            columns = motions(scene.mesh.nodes[nodes]).reshape(-1, 3, 6)
            for side, own in enumerate((interfaces.nodes, interfaces.others)):
                here = self.sides[:, side] == b
                self.columns[side, here] = columns[np.searchsorted(nodes, own[here])]
            fixed = np.zeros((len(nodes), 3), bool)
            for s in mine:
                fixed[np.searchsorted(nodes, s.nodes)] |= s.fixed
            held = columns[fixed]
            self.support[b] = held.T @ held

    def free(self, normal: np.ndarray, tangential: np.ndarray) -> np.ndarray:
        """(bodies,) bool, whether each can move rigidly where pairs hold along and across the normal, (N,) bool each."""
        apart = []  # what the pairs forbid to change
        for columns in self.columns:
            along = np.einsum("ni,nij->nj", self.interfaces.normal, columns)
            opening = self.interfaces.normal[:, :, None] * along[:, None, :]
            apart.append(normal[:, None, None] * opening + tangential[:, None, None] * (columns - opening))
        gram = np.zeros((self.bodies, 6, self.bodies, 6))
        gram[range(self.bodies), :, range(self.bodies), :] = self.support
        offsets = self.interfaces.offsets
        for a, b in zip(offsets[:-1], offsets[1:]):
            if a == b:
                continue
            both = np.concatenate([apart[0][a:b].reshape(-1, 6), -apart[1][a:b].reshape(-1, 6)], axis=1)
            blocks = (both.T @ both).reshape(2, 6, 2, 6)
            for one, two in ((0, 0), (1, 1), (0, 1), (1, 0)):
                gram[self.sides[a, one], :, self.sides[a, two]] += blocks[one, :, two]
        values, vectors = np.linalg.eigh(gram.reshape(6 * self.bodies, -1))
        loose = vectors[:, values <= FREE * max(values[-1], 1e-300)].reshape(self.bodies, 6, -1)
        return np.linalg.norm(loose, axis=(1, 2)) > 1e-3
