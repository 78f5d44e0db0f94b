"""What happens on the interfaces that can open or jump, per load step: from the delivered traces.

Displacements and forces are the linear stage's, which is what the results hold inside the bodies too;
only the status (open, stick, slip) is the local stage's. T load steps, N interface nodes, I interfaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import COUNTED
from orchestrator.laws.status import BONDED
from orchestrator.method.interface.pairs import node_areas, pair_normals
from orchestrator.method.delivery.recovery import delivered
from orchestrator.method.iterated import Iterated
from orchestrator.scene.model import Interface


@dataclass(frozen=True)
class InterfaceFields:
    """Fields of all interfaces that are not perfect, interface after interface.

    Parameters
    ----------
    names, laws : (I,) texts
    subdomains : (I, 2) int, side 1 and side 2
    offsets : (I + 1,) int, where each interface's nodes start
    nodes, others : (N,) int, global node ids on side 1 and on side 2; they differ where the sides share no faces
    triangles : (M, 3) int, indices into the N nodes, oriented outward of side 1
    owner : (M,) int, the interface of each triangle
    normal : (N, 3) unit normals from side 1 to side 2; area : (N,) each node's share of its interface
    initial_gap : (N,) length, negative for a press fit
    gap : (T, N) length, distance of the sides along the normal
    slip : (T, N, 3) length, tangential displacement of side 2 relative to side 1 since the unloaded state
    pressure : (T, N) force/length², positive in compression
    friction_traction : (T, N, 3) force/length², tangential traction on side 1
    status : (T, N) int, as the laws declare them: 0 open, 1 stick, 2 slip, 3 bonded (imposed jump, or held by boundary
        conditions) …
    kinds, kind_names, kind_colours : (K,) numbers, names and colours (#rrggbb) of the statuses that there may be
    resultant : (T, I, 3) force of side 2 on side 1, without what prescribed nodes carry
    """

    names: np.ndarray
    laws: np.ndarray
    subdomains: np.ndarray
    offsets: np.ndarray
    nodes: np.ndarray
    others: np.ndarray
    triangles: np.ndarray
    owner: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    initial_gap: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    pressure: np.ndarray
    friction_traction: np.ndarray
    status: np.ndarray
    kinds: np.ndarray
    kind_names: np.ndarray
    kind_colours: np.ndarray
    resultant: np.ndarray

    @property
    def steps(self) -> int:
        return len(self.gap)

    @property
    def interface_of_node(self) -> np.ndarray:
        """(N,) int."""
        return np.repeat(np.arange(len(self.names)), np.diff(self.offsets))

    @property
    def counts(self) -> dict[str, list[int]]:
        """Nodes that are open, stick, slip, or what else the laws know, per load step; bonded ones have no choice."""
        found = {name: [0] * self.steps for name in COUNTED}
        return found | {str(name): (self.status == kind).sum(axis=1).tolist()
                        for kind, name in zip(self.kinds, self.kind_names) if kind != BONDED}


def interface_fields(d: Decomposition, iterated: Iterated) -> InterfaceFields | None:
    """Fields of the interfaces that are not perfect, on rank 0; None elsewhere, and where all are."""
    if d.all_perfect:
        return None
    pairs, steps = d.local.pairs, d.scene.steps
    chosen = [i for i in d.scene.interfaces if not i.law.perfect]
    corners = [i.corners for i in chosen]  # mid-edge nodes are tied to them
    offsets = np.cumsum([0] + [len(c) for c in corners])
    place = _places(pairs.interfaces, {i.index: a for i, a in zip(chosen, offsets)})
    normal, length = (np.concatenate([x[c] for x, c in zip(both, corners)])
                      for both in zip(*(pair_normals(d.scene.points(i), i) for i in chosen)))
    area = np.concatenate([node_areas(d.scene.points(i), i.triangles)[c] for i, c in zip(chosen, corners)])
    initial = np.concatenate([np.broadcast_to(i.law.distance, len(i.free))[c] for i, c in zip(chosen, corners)])

    jump, force = np.zeros((2, steps, len(normal), 3))
    status = np.full((steps, len(normal)), BONDED, dtype=np.int32)  # nodes left out of the pairs are prescribed
    at = pairs.traces(*iterated.fields.extended)
    jumps, forces = (x.transpose(0, 2, 1) for x in (at.jump, at.force))
    mine = pairs.mine
    parts = d.space.team.gather((place[mine], jumps[:, mine], forces[:, mine], iterated.local.status[:, mine]))
    if parts is None:
        return None
    for place, jumps, forces, kinds in parts:
        jump[:, place], force[:, place], status[:, place] = jumps, forces, kinds
    opening, push = (np.einsum("tni,ni->tn", x, normal) for x in (jump, force))
    traction = (force - push[:, :, None] * normal) / area[:, None]
    resultant = np.stack([force[:, a:b].sum(axis=1) for a, b in zip(offsets[:-1], offsets[1:])], axis=1)
    return InterfaceFields(
        np.array([i.name for i in chosen]), np.array([i.law.name for i in chosen]),
        np.array([i.subdomains for i in chosen]), offsets,
        *(np.concatenate([d.scene.side_nodes(i, side)[c] for i, c in zip(chosen, corners)]) for side in (0, 1)),
        np.concatenate([np.searchsorted(c, i.triangles[:, :3]) + a for i, c, a in zip(chosen, corners, offsets)]),
        np.repeat(np.arange(len(chosen)), [len(i.triangles) for i in chosen]), normal, area, initial,
        initial + length * opening, jump - opening[:, :, None] * normal, -push / (length * area), traction, status,
        *(np.array(x) for x in zip(*((int(s), s.name, s.colour) for s in pairs.statuses))), resultant)


def _places(interfaces: list[Interface], start: dict[int, int]) -> np.ndarray:
    """(P,) where each pair's node is: pairs leave out the nodes on which everything is prescribed."""
    places = [start[i.index] + np.flatnonzero(i.free[i.corners].any(axis=1)) for i in interfaces]
    return np.concatenate(places) if places else np.zeros(0, int)


def sides(d: Decomposition, iterated: Iterated, parts: list[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Displacements where interfaces open: the bodies' own, and one per node of the input mesh.

    Parameters
    ----------
    parts : per subdomain (T, n_E, 3), as recovered

    Returns
    -------
    displacement : (T, n, 3), the mean of the copies of each node
    sides : per subdomain (T, n_E, 3), continuous over perfect interfaces
    """
    total = np.zeros((d.scene.steps, len(d.scene.mesh.nodes), 3))
    copies = np.zeros(len(d.scene.mesh.nodes))
    result = delivered(d, iterated.bound, parts)
    for s, own in zip(d.scene.subdomains, result):
        if own is not None:
            total[:, s.nodes] += own
            copies[s.nodes] += 1
    return total / np.maximum(copies, 1)[:, None], result
