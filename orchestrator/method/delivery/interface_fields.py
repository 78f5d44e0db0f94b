"""What happens on the interfaces that can open or jump, per load step: from the delivered traces.

Displacements and forces are the linear stage's, which is what the results hold inside the bodies too;
only the status (open, stick, slip) is the local stage's. T load steps, N interface nodes, I interfaces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import COUNTED
from orchestrator.laws.status import BONDED
from orchestrator.method.interface.pair_geometry import lawful_nodes, pair_normals, point_areas
from orchestrator.method.iterated import Iterated
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.model import Interface, Scene


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
    normal : (N, 3) unit normals from side 1 to side 2; area : (N,) each node's share of its interface; of the last load step
        where sides are paired anew as they slide
    initial_gap : (N,) length, negative for a press fit; of one with a history, at the load step that asks for most
    gap : (T, N) length, distance of the sides along the normal
    slip : (T, N, 3) length, tangential displacement of side 2 relative to side 1 since the unloaded state
    pressure : (T, N) force/length², positive in compression
    friction_traction : (T, N, 3) force/length², tangential traction on side 1
    status : (T, N) int, as the laws declare them: 0 open, 1 stick, 2 slip, 3 bonded (imposed jump, or held by boundary
        conditions) …
    kinds, kind_names, kind_colours : (K,) numbers, names and colours (#rrggbb) of the statuses that there may be
    resultant : (T, I, 3) force of side 2 on side 1, without what prescribed nodes carry
    areas : (T, N) ``area`` at each load step; zero where nothing is opposite
    own : name → (T, N) the laws' own variables, such as a damage; 0 at nodes of other laws
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
    areas: np.ndarray
    own: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def joined(cls, parts: Sequence[InterfaceFields], order: np.ndarray) -> InterfaceFields:
        """Those of several sets of interfaces.

        Parameters
        ----------
        order : (I,) int, which of all interfaces, set after set, comes first, second, …; others are left out
        """
        counts, faces = (np.concatenate([c(p) for p in parts]) for c in (
            lambda p: np.diff(p.offsets), lambda p: np.bincount(p.owner, minlength=len(p.names))))
        node, face = (_segments(c, order) for c in (counts, faces))
        offsets = np.concatenate([[0], np.cumsum(counts[order])])
        starts = np.concatenate([[0], np.cumsum([len(p.nodes) for p in parts])])
        place = np.empty(int(counts.sum()), dtype=int)
        place[node] = np.arange(len(node))
        triangles = np.concatenate([p.triangles + a for p, a in zip(parts, starts)])

        def chosen(name: str, which: np.ndarray, axis: int = 0) -> np.ndarray:
            return np.concatenate([getattr(p, name) for p in parts], axis=axis).take(which, axis=axis)

        return cls(*(chosen(name, order) for name in ("names", "laws", "subdomains")), offsets,
                   *(chosen(name, node) for name in ("nodes", "others")), place[triangles[face]],
                   np.repeat(np.arange(len(order)), faces[order]),
                   *(chosen(name, node) for name in ("normal", "area", "initial_gap")),
                   *(chosen(name, node, 1) for name in ("gap", "slip", "pressure", "friction_traction", "status")),
                   parts[0].kinds, parts[0].kind_names, parts[0].kind_colours, chosen("resultant", order, 1), chosen("areas", node, 1),
                   {name: np.concatenate([p.own[name] for p in parts], axis=1).take(node, axis=1) for name in parts[0].own})

    @property
    def steps(self) -> int:
        return len(self.gap)

    @property
    def interface_of_node(self) -> np.ndarray:
        """(N,) int."""
        return np.repeat(np.arange(len(self.names)), np.diff(self.offsets))

    @property
    def counts(self) -> dict[str, list[int]]:
        """Nodes that are open, stick, slip, or what else the laws know, per load step; bonded ones have no choice, and those
        that have slid off the other side are left out."""
        found = {name: [0] * self.steps for name in COUNTED}
        return found | {str(name): ((self.status == kind) & (self.areas > 0)).sum(axis=1).tolist()
                        for kind, name in zip(self.kinds, self.kind_names) if kind != BONDED}


def own_interfaces(d: Decomposition) -> list[Interface]:
    """Those that are not perfect and whose first side is this rank's, in the order of the scene."""
    here = set(d.space.subdomains)
    return [i for i in d.scene.interfaces if not i.law.perfect and i.subdomains[0] in here]


def interface_fields(d: Decomposition, iterated: Iterated) -> InterfaceFields | None:
    """Fields of the interfaces that are not perfect, of those whose first side is this rank's; None where all are."""
    if d.all_perfect or all(i.law.perfect for i in d.scene.interfaces) and d.nonlinear is not None:
        return None
    pairs, steps, scene = d.local.pairs, d.scene.steps, d.scene
    chosen = own_interfaces(d)
    corners = [i.corners for i in chosen]  # mid-edge nodes are tied to them
    offsets = np.cumsum([0] + [len(c) for c in corners])
    start = {i.index: a for i, a in zip(chosen, offsets)}
    place, corner = _places([i for i in pairs.interfaces if i.index in start], start)
    shown = corner[:, 1] < 0
    initial = _joined([np.broadcast_to(i.law.distance, len(i.free))[c] for i, c in zip(chosen, corners)])
    apart = np.concatenate([i.distances(steps)[:, c] for i, c in zip(chosen, corners)], axis=1) if chosen else np.zeros((steps, 0))

    jump, force = np.zeros((2, steps, offsets[-1], 3))
    status = np.full((steps, offsets[-1]), BONDED, dtype=np.int32)  # nodes left out of the pairs are prescribed
    gap, slip, pressure, traction, areas = (np.zeros((steps, offsets[-1], *more)) for more in ((), (3,), (), (3,), ()))
    own = {v.name: np.zeros((steps, offsets[-1])) for i in scene.interfaces for v in i.law.variables}
    resultant = np.zeros((steps, len(chosen), 3))
    for t, here, _ in iterated.by_pairing(d):
        both = [pair_normals(scene.points(i), i) for i in chosen]
        normal = _joined([n[c] for (n, _), c in zip(both, corners)], (0, 3))
        length = _joined([l[c] for (_, l), c in zip(both, corners)])
        areas[t] = area = _joined([point_areas(scene.points(i), i)[c] for i, c in zip(chosen, corners)])
        at = here.traces(*(x[t] for x in iterated.fields.extended))
        mine = here.mine
        jumps, forces = (x.transpose(0, 2, 1)[:, mine] for x in (at.jump, at.force))
        jump[t, place[shown]], status[t, place[shown]] = jumps[:, shown], iterated.local.status[t][:, mine][:, shown]
        force[t, place[shown]] = forces[:, shown]
        for name in own.keys() & iterated.local.own.keys():
            own[name][t, place[shown]] = iterated.local.own[name][t][:, mine][:, shown]
        for end in corner[~shown].T:  # what acts in the middle of an edge acts on its ends, half on each
            np.add.at(force, (t, end), 0.5 * forces[:, ~shown])
        opening, push = (np.einsum("tni,ni->tn", x[t], normal) for x in (jump, force))
        size = np.where(area > 0, area, np.inf)
        traction[t], pressure[t] = (force[t] - push[:, :, None] * normal) / size[:, None], -push / (length * size)
        gap[t], slip[t] = apart[t] + length * opening, jump[t] - opening[:, :, None] * normal
        for index, (a, b) in enumerate(zip(offsets[:-1], offsets[1:])):
            resultant[t, index] = force[t, a:b].sum(axis=1)
            if chosen[index].mortar is not None:
                _spread(chosen[index], scene.points(chosen[index]), status[t, a:b],
                        *(x[t, a:b] for x in (gap, slip, pressure, traction, *own.values())))
    return InterfaceFields(
        np.array([i.name for i in chosen], dtype=str), np.array([i.law.name for i in chosen], dtype=str),
        np.array([i.subdomains for i in chosen], dtype=int).reshape(-1, 2), offsets,
        *(_joined([nodes[c] for nodes, c in zip(side, corners)]).astype(int) for side in (zip(*(_nodes(scene, i) for i in chosen)) if chosen else ((), ()))),
        _joined([np.searchsorted(c, i.triangles[:, :3]) + a for i, c, a in zip(chosen, corners, offsets)], (0, 3)).astype(int),
        np.repeat(np.arange(len(chosen)), [len(i.triangles) for i in chosen]), normal, area, initial,
        gap, slip, pressure, traction, status,
        *(np.array(x) for x in zip(*((int(s), s.name, s.colour) for s in pairs.statuses))), resultant, areas, own)


def all_interfaces(d: Decomposition, own: InterfaceFields | None) -> InterfaceFields | None:
    """The fields of all ranks on rank 0, in the order of the scene and with its numbers of nodes; as given elsewhere."""
    if own is None or d.space.team.size == 1:
        return own
    told = replace(own, nodes=d.scene.number[own.nodes], others=d.scene.number[own.others])
    everyone = d.space.team.gather(([i.index for i in own_interfaces(d)], told))
    if everyone is None:
        return own
    index = np.concatenate([numbers for numbers, _ in everyone]).astype(int)
    return InterfaceFields.joined([fields for _, fields in everyone], np.argsort(index))


def _segments(counts: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Where the entries of segments of these lengths are, if the segments are put in another order."""
    starts = np.cumsum(counts) - counts
    return np.concatenate([np.empty(0, int)] + [np.arange(starts[i], starts[i] + counts[i]) for i in order])


def _nodes(scene: Scene, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """(n,) global ids of an interface's nodes on side 1, and of those opposite: where nodes do not match, the nearest."""
    one, two = (scene.side_nodes(interface, side) for side in (0, 1))
    if interface.mortar is None:
        return one, two
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    return one, two[cKDTree(scene.mesh.nodes[two]).query(scene.mesh.nodes[one])[1]]


def _spread(interface: Interface, points: np.ndarray, status: np.ndarray, *fields: np.ndarray) -> None:
    """Give nodes that carry no point, and corners of the same surface, what the points have that took over their share.

    Parameters
    ----------
    points : (n, 3) the interface's nodes
    status : (T, c) at its corners; fields : (T, c) or (T, c, 3), all set in place
    """
    mortar, corners = interface.mortar, interface.corners
    own = np.searchsorted(corners, mortar.points)
    rest = np.setdiff1d(np.arange(len(corners)), own)
    if not len(rest) or interface.moving is not None:  # what slides on has its points everywhere
        return
    shares = sp.csr_array(mortar.first[::3, ::3].T @ sp.diags_array(mortar.area))[corners[rest]]
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    nearest = cKDTree(points[mortar.points]).query(points[corners[rest]])[1]
    empty = np.flatnonzero(np.diff(shares.indptr) == 0)
    shares = shares + sp.csr_array((np.ones(len(empty)), (empty, nearest[empty])), shape=shares.shape)
    shares = sp.csr_array(sp.diags_array(1 / shares.sum(axis=1)) @ shares)
    status[:, rest] = status[:, own[nearest]]
    for field in fields:
        field[:, rest] = np.moveaxis(np.tensordot(shares.toarray(), field[:, own], axes=(1, 1)), 0, 1)


def _places(interfaces: list[Interface], start: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(P,) where each pair's node is: pairs leave out the nodes on which everything is prescribed. And (P, 2), of pairs in the
    middle of an edge, where its ends are; −1 for all others."""
    places, ends = [np.zeros(0, int)], [np.zeros((0, 2), int)]
    for i in interfaces:
        at = lawful_nodes(i)
        places.append(start[i.index] + np.searchsorted(i.corners, at))
        ends.append(np.full((len(at), 2), -1))
        if len(at) > np.isin(at, i.corners).sum():
            edge, number = edges_of(i.triangles, TRIANGLE_EDGES)
            of_node = np.full((len(i.free), 2), -1)
            of_node[i.triangles[:, 3:].ravel()] = start[i.index] + np.searchsorted(i.corners, edge[number.ravel()])
            ends[-1] = of_node[at]
    return np.concatenate(places), np.concatenate(ends)


def mean_of_sides(scene: Scene, sides: list[np.ndarray]) -> np.ndarray:
    """(T, n, 3) one displacement per node of the mesh where interfaces open: the mean of its copies.

    Parameters
    ----------
    scene : the whole one
    sides : per subdomain (T, n_E, 3), continuous over perfect interfaces
    """
    total = np.zeros((scene.steps, len(scene.mesh.nodes), 3))
    copies = np.zeros(len(scene.mesh.nodes))
    for s, own in zip(scene.subdomains, sides):
        total[:, s.nodes] += own
        copies[s.nodes] += 1
    return total / np.maximum(copies, 1)[:, None]


def _joined(parts: list[np.ndarray], empty: tuple[int, ...] = (0,)) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(empty)
