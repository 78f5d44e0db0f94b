"""Fields on the interfaces that can open or jump, per load step, from the delivered traces: of each
rank's own.

Where an energy error is known, displacements are v's and forces are λ̂, which laws allow to the
last digit, with their statuses (open, stick, slip); see ``stopping.certificate``. Elsewhere
displacements and forces are the linear stage's, and only the status is the local stage's. T load
steps, N interface nodes, I interfaces.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import BONDED
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.events import COUNTED
from orchestrator.method.interface.pairing import Geometry, geometry_of, lawful_nodes
from orchestrator.method.interface.rows import bounds_of, joined, times
from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.iterated import Iterated
from orchestrator.method.stopping.certificate import Pair
from orchestrator.scene.interfaces.mortar.operators import scalar
from orchestrator.scene.mesh.geometry import areas
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.mesh.faces import runs
from orchestrator.scene.model import Scene


SHIFTS = ("shift_normal", "shift_tangential")
UNWRITTEN = ("points", "index")
# Which arrays run along interfaces, nodes and triangles, and on which of their axes.
ALONG = dict.fromkeys(("names", "laws", "subdomains", "index"),
                      ("interface", 0)) | {"resultant": ("interface", 1)} | dict.fromkeys(
    ("nodes", "others", "normal", "area", "initial_gap"), ("node", 0)) | dict.fromkeys(
    ("points", "gap", "slip", "pressure", "friction_traction", "status", "areas", *SHIFTS),
    ("node", 1)) | dict.fromkeys(
    ("triangles", "owner"), ("triangle", 0))


@dataclass(frozen=True)
class InterfaceFields:
    """Fields of all interfaces that are not perfect, interface after interface."""

    names: np.ndarray  # (I,) texts
    laws: np.ndarray  # (I,) texts
    subdomains: np.ndarray  # (I, 2) int, side 1 and side 2
    offsets: np.ndarray  # (I + 1,) int, where each interface's nodes start
    nodes: np.ndarray  # (N,) int, global node ids on side 1
    others: np.ndarray  # (N,) the same on side 2; they differ where the sides share no faces
    triangles: np.ndarray  # (M, 3) int, indices into the N nodes, oriented outward of side 1
    owner: np.ndarray  # (M,) int, the interface of each triangle
    # (N, 3) unit, from side 1 to side 2; of the last load step where sides are paired anew as they
    # slide. −p A n + A f_t is what acts on side 1 in the components that supports do not hold on
    # both sides: what they carry of it is theirs
    normal: np.ndarray
    area: np.ndarray  # (N,) each node's share of its interface; the same
    # (N,) length, negative for a press fit; of one with a history, at the load step that asks for
    # most
    initial_gap: np.ndarray

    gap: np.ndarray  # (T, N) length, distance of the sides along the normal
    # (T, N, 3) length, tangential displacement of side 2 relative to side 1 since the unloaded
    # state
    slip: np.ndarray
    pressure: np.ndarray  # (T, N) force/length², positive in compression
    friction_traction: np.ndarray  # (T, N, 3) force/length², tangential traction on side 1
    # (T, N) int, as the laws declare them: 0 open, 1 stick, 2 slip, 3 bonded (jump given, or held)
    # …
    status: np.ndarray
    kinds: np.ndarray  # (K,) numbers of the statuses that there may be
    kind_names: np.ndarray  # (K,) and their names
    kind_colours: np.ndarray  # (K,) and colours, #rrggbb
    # (T, I, 3) force of side 2 on side 1, without what prescribed nodes carry
    resultant: np.ndarray
    areas: np.ndarray  # (T, N) ``area`` at each load step; zero where nothing is opposite
    # name → (T, N) the laws' own variables; 0 at nodes of other laws
    own: Mapping[str, np.ndarray] = field(default_factory=dict)
    # (T, N) lengths, how far the sides would have to be moved apart, and across the normal, for the
    # result to be exact; None: not known
    shift_normal: np.ndarray | None = None
    shift_tangential: np.ndarray | None = None
    # of a run that has just been solved, in no file
    points: np.ndarray | None = None  # (2, N, 3) where ``nodes`` and ``others`` are
    # (I,) int, ascending, which of the scene's that are not perfect these are
    index: np.ndarray | None = None

    @property
    def interface_of_node(self) -> np.ndarray:
        """(N,) int."""
        return np.repeat(np.arange(len(self.names)), np.diff(self.offsets))

    def each(self) -> Iterator[tuple[int, slice]]:
        """Every interface's number, and its nodes."""
        return enumerate(slice(int(a), int(b)) for a, b in zip(self.offsets[:-1], self.offsets[1:]))

    def some(self, chosen: np.ndarray) -> InterfaceFields:
        """Some of the interfaces (K,) int, in this order."""
        counts = np.column_stack([np.diff(self.offsets),
                                  np.bincount(self.owner, minlength=len(self.names))])
        starts = np.cumsum(counts, axis=0) - counts
        rows = {"interface": chosen} | {what: runs(starts[chosen, k], counts[chosen, k])
                                        for k, what in enumerate(("node", "triangle"))}
        taken = {name: x.take(rows[of], axis=axis) for name, (of, axis) in ALONG.items()
                 if (x := getattr(self, name)) is not None}
        offsets, faces = bounds_of(counts[chosen, 0]), counts[chosen, 1]
        moved = np.repeat(offsets[:-1] - self.offsets[chosen], faces)[:, None]
        return replace(self, **taken | {"offsets": offsets, "triangles": taken["triangles"] + moved,
                                        "owner": np.repeat(np.arange(len(chosen)), faces)},
                       own={name: x.take(rows["node"], axis=1) for name, x in self.own.items()})

    def numbered(self, number: np.ndarray | None) -> InterfaceFields:
        """The same with numbers (n,) int of nodes that are those of the whole mesh; None: they are
        already.
        """
        return self if number is None else replace(self, nodes=number[self.nodes],
                                                   others=number[self.others])

    @property
    def steps(self) -> int:
        return len(self.gap)

    @property
    def counts(self) -> dict[str, list[int]]:
        """Nodes that are open, stick, slip, or what else the laws know, per load step; bonded ones
        have no choice, and those
        that have slid off the other side are left out."""
        found = {name: [0] * self.steps for name in COUNTED}
        return found | {str(name): ((self.status == kind) & (self.areas > 0)).sum(axis=1).tolist()
                        for kind, name in zip(self.kinds, self.kind_names) if kind != BONDED}


def own_interfaces(d: Decomposition) -> list[Interface]:
    """Interfaces that are not perfect and whose first side is this rank's, in the order of the
    scene.
    """
    here = set(d.space.subdomains)
    return [i for i in d.scene.opening if i.subdomains[0] in here]


def interface_fields(d: Decomposition, iterated: Iterated, pair: Pair | None = None,
                     shift: np.ndarray | None = None) -> InterfaceFields | None:
    """Fields of the interfaces that are not perfect, of those whose first side is this rank's; None
    where all are.

    pair : the admissible fields, if an energy error is known
    shift : (T, 3, P) of the pairs' jumps, see ``stopping.backward``, those of perfect interfaces
        last; None: not known
    """
    if d.scene.bonded:
        return None
    pairs, steps, scene, chosen = d.local.pairs, d.scene.steps, d.scene, own_interfaces(d)
    shown = [i.shown for i in chosen]
    offsets = bounds_of([len(c) for c in shown])
    start = {i.index: a for i, a in zip(chosen, offsets)}
    place, corner = _places([i for i in pairs.interfaces if i.index in start], start)
    own_node, mine = corner[:, 1] < 0, np.flatnonzero(pairs.mine)
    to, taken, halved, ends = place[own_node], mine[own_node], mine[~own_node], corner[~own_node].T
    apart = np.hstack([np.zeros((steps, 0)),
                       *(i.distances(steps)[:, c] for i, c in zip(chosen, shown))])
    force = np.zeros((steps, offsets[-1], 3))
    status = np.full(force.shape[:2], BONDED, dtype=np.int32)  # others are prescribed
    gap, slip, pressure, traction, every = (np.zeros((steps, offsets[-1], *more))
                                            for more in ((), (3,), (), (3,), ()))
    shifts = np.zeros((0 if shift is None else 2, *gap.shape))  # along the normal and across it
    own = {name: np.zeros_like(gap) for i in scene.interfaces for name in i.law.variables}
    resultant = np.zeros((steps, len(chosen), 3))
    for t, here, _ in iterated.by_pairing():
        at = geometry_shown(scene, chosen)
        acting, every[t] = at.acting, at.area
        jumps, forces, statuses, own_values = _stages(here, iterated, pair, t)
        jumps, forces = (x.transpose(0, 2, 1) for x in (jumps, forces))
        jump = np.zeros_like(force[t])
        jump[:, to], force[t, to] = jumps[:, taken], forces[:, taken]
        status[t, to] = statuses[:, taken]
        for name in own.keys() & own_values.keys():
            own[name][t, to] = own_values[name][:, taken]
        for end in ends:  # what acts in the middle of an edge acts on its ends, half on each
            np.add.at(force, (t, end), 0.5 * forces[:, halved])
        (opening, slip[t]), (push, shear) = _parted(jump, acting), _parted(force[t], acting)
        size = np.where(at.area > 0, at.area, np.inf)
        traction[t], pressure[t] = shear / size[:, None], -push / (at.length * size)
        gap[t] = apart[t] + at.length * opening
        if len(shifts):
            moved = np.zeros_like(jump)
            moved[:, to] = shift[t].transpose(0, 2, 1)[:, taken]
            along, across = _parted(moved, acting)
            shifts[:, t] = at.length * along, np.linalg.norm(across, axis=2)
        for k, (i, a, b) in enumerate(zip(chosen, offsets[:-1], offsets[1:])):
            resultant[t, k] = force[t, a:b].sum(axis=1)
            if i.mortar is not None:
                spread = status, gap, slip, pressure, traction, *own.values(), *shifts
                _spread(i, scene.points(i), *(x[t, a:b] for x in spread))
    kinds = zip(*((int(s), s.name, s.colour) for s in pairs.statuses))
    return InterfaceFields(
        **_meeting(scene, chosen, shown, offsets), normal=at.normal, area=at.area, gap=gap,
        slip=slip, pressure=pressure, friction_traction=traction, status=status,
        **dict(zip(("kinds", "kind_names", "kind_colours"), map(np.array, kinds))),
        resultant=resultant, areas=every, own=own, **dict(zip(SHIFTS, shifts)),
        index=np.flatnonzero([i.subdomains[0] in d.space.subdomains for i in scene.opening]))


def _meeting(scene: Scene, chosen: Sequence[Interface], shown: Sequence[np.ndarray],
             offsets: np.ndarray) -> dict[str, np.ndarray]:
    """Return those of ``InterfaceFields`` that are the same at all load steps.

    shown : per interface, nodes that fields are told at; offsets : where these start
    """
    pairs_of = [_nodes(scene, i) for i in chosen]
    nodes, others = (_at_shown([x[k] for x in pairs_of], shown).astype(int, copy=False)
                     for k in (0, 1))
    distance = _at_shown([np.broadcast_to(i.law.distance, len(i.free)) for i in chosen], shown)
    triangles = [i.shown_triangles for i in chosen]
    return {"names": np.array([i.name for i in chosen], dtype=str),
            "laws": np.array([i.law.name for i in chosen], dtype=str),
            "subdomains": ends_of(chosen), "offsets": offsets, "nodes": nodes, "others": others,
            "triangles": joined([np.searchsorted(c, x) + a
                                 for x, c, a in zip(triangles, shown, offsets)], (0, 3)),
            "owner": np.repeat(np.arange(len(chosen)), [len(x) for x in triangles]),
            "initial_gap": distance.astype(float, copy=False),
            "points": scene.mesh.nodes[np.stack([nodes, others])]}


def _at_shown(values: Iterable[np.ndarray], shown: Iterable[np.ndarray]) -> np.ndarray:
    """(N,) of values at the nodes shown of each interface."""
    return joined([x[c] for x, c in zip(values, shown)])


def geometry_shown(scene: Scene, chosen: Sequence[Interface]) -> Geometry:
    """Return normals and areas at the nodes of some interfaces that fields are told at, one
    interface after the other."""
    each = [(geometry_of(scene.points(i), i, i.shown_shares), i.shown) for i in chosen]
    empty = {"normal": (0, 3), "acting": (0, 3)}
    names = [f.name for f in fields(Geometry)]
    return Geometry(
        *(joined([getattr(at, name)[shown] for at, shown in each], empty.get(name, (0,)))
                      for name in names))


def _parted(x: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(steps, N) components of vectors (steps, N, 3) along normals (N, 3), and (steps, N, 3) what
    is across.
    """
    along = np.einsum("tni,ni->tn", x, normal)
    return along, x - along[:, :, None] * normal


def _stages(pairs: Pairs, iterated: Iterated, pair: Pair | None, t: slice) -> tuple:
    """Jumps and forces (steps, 3, P) at load steps ``t``, statuses (steps, P), and the laws' own
    variables, by their names.
    """
    if pair is None:
        at = pairs.traces(*(x[t] for x in iterated.fields.extended))
        return at.jump, at.force, iterated.local.status[t], {
            name: x[t] for name, x in iterated.local.own.items()}
    answers = pair.answers[t]  # of more points: those of perfect interfaces come last
    return (pair.jump[t], pair.forces[t], np.array([a.status for a in answers]),
            {name: np.array([a.own[name] for a in answers]) for name in answers[0].own})


def _nodes(scene: Scene, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """(n,) global ids of an interface's nodes on side 1, and of those opposite: where nodes do not
    match, the nearest.
    """
    one, two = (scene.side_nodes(interface, side) for side in (0, 1))
    if interface.paired:
        return one, two
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    return one, two[cKDTree(scene.mesh.nodes[two]).query(scene.mesh.nodes[one])[1]]


def _spread(interface: Interface, points: np.ndarray, status: np.ndarray,
            *fields: np.ndarray) -> None:
    """Give nodes that carry no point, and those of the same surface that are shown, what the points
    have that took over their share.

    points : (n, 3) the interface's nodes
    status : (T, c) at those shown; fields : (T, c) or (T, c, 3), all set in place
    """
    mortar, shown = interface.mortar, interface.shown
    own = np.searchsorted(shown, mortar.points)
    rest = np.setdiff1d(np.arange(len(shown)), own)
    if not len(rest) or interface.moving is not None:  # what slides on has its points everywhere
        return
    if interface.amid:
        shares = _beside(interface, points)[shown[rest]]
    # a corner's function there has no share: its integral over a face is 0
    elif interface.triangles.shape[1] == 6:
        shares = sp.csr_array((len(rest), len(own)))
    else:
        shares = sp.csr_array(scalar(mortar.first).T @ sp.diags_array(mortar.area))[shown[rest]]
    from scipy.spatial import cKDTree  # only scenes of several parts need it

    nearest, empty = cKDTree(points[mortar.points]).query(points[shown[rest]])[1], np.flatnonzero(
        np.diff(shares.indptr) == 0)
    shares = shares + sp.csr_array((np.ones(len(empty)), (empty, nearest[empty])),
                                   shape=shares.shape)
    shares = sp.diags_array(1 / shares.sum(axis=1)) @ shares
    status[:, rest] = status[:, own[nearest]]
    for values in fields:
        there = values.reshape(*values.shape[:2], -1)
        there[:, rest] = np.stack([times(shares, x) for x in there[:, own].transpose(2, 0, 1)],
                                  axis=2)


def _beside(interface: Interface, points: np.ndarray) -> sp.csr_array:
    """(n, p) of a corner and the points in the middle of edges that end there, the area that they
    have in common: means that laws
    allow where they allow each."""
    number = np.full(len(points), -1)
    number[interface.mortar.points] = np.arange(len(interface.mortar))
    ends, middles = TRIANGLE_EDGES.ravel(), np.repeat(np.arange(3, 6), 2)
    corner, middle = interface.triangles[:,
                                         ends].ravel(), number[
                                             interface.triangles[:, middles]].ravel()
    area = np.repeat(areas(points, interface.triangles), 6)
    there = middle >= 0
    return sp.csr_array((area[there], (corner[there], middle[there])),
                        shape=(len(points), len(interface.mortar)))


def _places(interfaces: list[Interface], start: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(P,) where each pair's node is: pairs leave out the nodes on which everything is prescribed.
    And (P, 2), of pairs in the
    middle of an edge, where its ends are; −1 for all others."""
    places, ends = [np.zeros(0, int)], [np.zeros((0, 2), int)]
    for i in interfaces:
        at, of_node = lawful_nodes(i), np.full((len(i.free), 2), -1)
        places.append(start[i.index] + np.searchsorted(i.shown, at))
        if not np.isin(at, i.shown).all():
            edge, number = edges_of(i.triangles, TRIANGLE_EDGES)
            of_node[i.triangles[:, 3:].ravel()] = start[i.index] + np.searchsorted(
                i.shown, edge[number.ravel()])
        ends.append(of_node[at])
    return np.concatenate(places), np.concatenate(ends)
