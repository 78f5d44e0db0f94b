"""What is asked to be certified, and the intervals that the energy error gives for it, see ``stopping.intervals``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from orchestrator.errors import Refusal
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.lawful import Lawful
from orchestrator.method.iterated import Iterated
from orchestrator.method.interface.rows import dots
from orchestrator.method.stopping.influence import Asked, InfluenceFields
from orchestrator.method.stopping.intervals import PointLoads, of_displacements, of_forces
from orchestrator.scene.conditions.probes import Point
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions
from orchestrator.scene.model import Scene

REACTIONS, BOLTS, SECTIONS, RESULTANTS = KINDS = ("reactions", "bolts", "sections", "resultants")
Weights = Mapping[int, tuple[np.ndarray, np.ndarray]]  # subdomain → local nodes (n,), and what each counts for (n,)


@dataclass(frozen=True)
class Wanted:
    """What is asked for.

    probes : name → weights of a displacement at nodes
    reactions : whether those are; entries : numbers of the entries of ``boundary`` that hold something then
    interfaces : numbers of the interfaces whose forces are
    bolts : name → number of the interface at its cut, and axis (3,)
    """

    probes: dict[str, Weights] = field(default_factory=dict)
    reactions: bool = False
    entries: list[int] = field(default_factory=list)
    interfaces: list[int] = field(default_factory=list)
    bolts: dict[str, tuple[int, np.ndarray]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.probes or self.reactions or self.interfaces or self.bolts)

    @classmethod
    def of(cls, scene: Scene, names: Sequence[str], kinds: Sequence[str]) -> Wanted:
        """Of a whole scene; ``names``: of its probes of displacements, at points or means over surfaces; ``kinds``: of ``KINDS``.

        Raises Refusal: a probe in a part whose mesh is not ours
        """
        return cls({p.name: _weights(scene, p) for p in scene.probes if p.name in names}, REACTIONS in kinds,
                   [b.index for b in scene.boundary if not b.forces and REACTIONS in kinds],
                   [i.index for i in scene.interfaces if (SECTIONS if i.law.perfect else RESULTANTS) in kinds],
                   {b.name: (b.interface.index, b.axis) for b in scene.bolts if BOLTS in kinds})


@dataclass(frozen=True)
class Intervals:
    """Least and greatest values, T load steps; infinite where the error says nothing.

    guaranteed : whether they are
    probes : name → (T, 3, 2) components of displacement
    reactions : (entries, T, 3, 2) forces, None where nobody asks
    interfaces : number of the interface → (T, 3, 2) force of side 2 on side 1
    bolts : name → (T, 2)
    """

    guaranteed: bool
    probes: dict[str, np.ndarray]
    reactions: np.ndarray | None
    interfaces: dict[int, np.ndarray]
    bolts: dict[str, np.ndarray]


def intervals(d: Decomposition, iterated: Iterated, lawful: Lawful, wanted: Wanted, continuous: Sequence[np.ndarray | None],
              reactions: np.ndarray, resultants: Resultants) -> Intervals:
    """Those that are wanted.

    continuous : per own subdomain (T, n_E, 3) v
    reactions, resultants : of û and λ̂, of all ranks; the first without what supports take of the rest
    """
    probes = _displacements(d, iterated, lawful, wanted.probes, continuous) if wanted.probes else {}
    entries, ways = wanted.entries, [(entry, np.eye(3)) for entry in wanted.entries]
    ways += [(i, np.eye(3)) for i in wanted.interfaces] + [(i, axis[None]) for i, axis in wanted.bolts.values()]
    ends = np.cumsum([0] + [len(axes) for _, axes in ways])
    far = _forces(d, lawful, ways, len(entries)) if ways else np.zeros((0, d.steps, 2))
    far = [far[a:b].transpose(1, 0, 2) for a, b in zip(ends[:-1], ends[1:])]  # (T, axes, 2)
    supported = np.repeat(reactions[:, :, :3, None], 2, axis=3) if wanted.reactions else None
    for entry, own in zip(entries, far):
        supported[entry] += own
    far = far[len(entries):]
    carried = {i: resultants.force[:, i, :, None] + own for i, own in zip(wanted.interfaces, far)}
    bolts = {name: (resultants.force[:, i] @ axis)[:, None] + own[:, 0]
             for (name, (i, axis)), own in zip(wanted.bolts.items(), far[len(wanted.interfaces):])}
    return Intervals(not np.isnan(lawful.judged.factor), probes, supported, carried, bolts)


def _weights(scene: Scene, probe) -> Weights:
    """What a probe's displacement is of nodes."""
    place = np.zeros(len(scene.mesh.cells), dtype=int)
    for s in scene.subdomains:
        place[s.cells] = np.arange(len(s.cells))
    if isinstance(probe, Point):
        cells, local = np.array([probe.cell]), np.arange(scene.mesh.cells.shape[1])[None]
        weight = tet_functions(probe.weights, scene.mesh.cells.shape[1])[None]
    else:
        area = np.linalg.norm(probe.area, axis=1)
        cells, local = probe.cells, (scene.mesh.cells[probe.cells][:, None, :] == probe.triangles[:, :, None]).argmax(axis=2)
        weight = area[:, None] / area.sum() * TRIANGLE_SHARES[probe.triangles.shape[1]]
    result = {}
    for e in np.unique(scene.cell_subdomain[cells]):
        own = np.flatnonzero(scene.cell_subdomain[cells] == e)
        s = scene.subdomains[e]
        if s.foreign:
            raise Refusal("certified in a foreign part", name=probe.name)
        nodes = s.connectivity[place[cells[own]][:, None], local[own]]
        result[int(e)] = nodes.ravel(), np.broadcast_to(weight[own] if len(weight) > 1 else weight, nodes.shape).ravel()
    return result


def _displacements(d: Decomposition, iterated: Iterated, lawful: Lawful, probes: Mapping[str, Weights],
                   continuous: Sequence[np.ndarray | None]) -> dict[str, np.ndarray]:
    space, team, count = d.space, d.space.team, 3 * len(probes)
    boundary, moved, energy = *np.zeros((2, count, len(space.global_dof))), np.zeros(count)
    value, requests, resultants = np.zeros((count, d.steps)), {}, []
    for e, s in enumerate(d.own):
        q = np.zeros((count, len(s.nodes), 3))
        for k, weights in enumerate(probes.values()):
            if s.index in weights:
                nodes, weight = weights[s.index]
                for i in range(3):
                    np.add.at(q[3 * k + i, :, i], nodes, weight)
        value += np.einsum("qni,tni->qt", q, continuous[s.index])
        q = np.where(s.fixed, 0.0, q).reshape(count, -1)  # what is prescribed is known
        resultants.append((q @ d.made.modes[e]) @ lawful.certificate.forces.R[e])
        boundary[:, space.boundary[e]] = q[:, d.made.traces[e]]
        if q.any():
            requests[e] = np.hstack([q, np.zeros((count, 3 * d.made.node_counts[e] - q.shape[1]))])
    for e, answer in d.blackbox.fields(requests).items():
        moved[:, space.boundary[e]] = answer[:, d.made.traces[e]]
        energy += dots(requests[e], answer)
    energy, value = team.sum(energy, value)
    found = of_displacements(lawful.certificate, iterated.fields, lawful.judged, PointLoads(boundary, moved, energy, resultants))
    found = (value[:, :, None] + found).reshape(-1, 3, d.steps, 2)
    return {name: own.transpose(1, 0, 2) for name, own in zip(probes, found)}


def _forces(d: Decomposition, lawful: Lawful, ways: Sequence[tuple[int, np.ndarray]], entries: int) -> np.ndarray:
    """(n, T, 2) how far forces are from those of û and λ̂.

    ways : number of an entry of ``boundary``, for the first ``entries`` of them, then of interfaces, and axes (m, 3) of the forces; n axes
        in all
    """
    space, team, certificate = d.space, d.space.team, lawful.certificate
    count = sum(len(axes) for _, axes in ways)
    lifts = _lifts(d, ways[:entries], count)
    rest = np.zeros((count, 0, 3))  # of those that nothing holds, and of other ranks'
    known = space.known([SimpleNamespace(prescribed=lifts.get(e, rest)) for e in range(len(d.scene.subdomains))])
    anywhere, = team.max(float(known is not None))
    if anywhere and known is None:
        known = np.zeros((count, space.size))
    jump, start = _parted(d, lawful, ways[entries:], count)
    answered, energy, carried = _answered(d, lawful, lifts, known, count)
    moved = np.arange(count) < sum(len(axes) for _, axes in ways[:entries])
    influence = InfluenceFields(certificate, Asked(jump, start, known, answered, energy, moved))()
    return of_forces(certificate, lawful.judged, influence, carried, lawful.rest)


def _lifts(d: Decomposition, ways: Sequence[tuple[int, np.ndarray]], count: int) -> dict[int, np.ndarray]:
    """Own subdomain → (n, n_E, 3) unit motions of the supports of entries, those that there are."""
    lifts = {}
    for s in d.own:
        if s.fixed.any():
            lift, row = np.zeros((count, len(s.nodes), 3)), 0
            for entry, axes in ways:
                lift[row: row + len(axes)] = axes[:, None] * (s.fixed & (s.held_by == entry))
                row += len(axes)
            lifts[s.index] = lift
    return lifts


def _parted(d: Decomposition, lawful: Lawful, ways: Sequence[tuple[int, np.ndarray]], count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, P) jumps, and (n, B) boundary values that have them: side 1 of an interface moves, all else rests."""
    space, pairs = d.space, lawful.certificate.pairs
    traces, start = np.zeros((count, space.size)), np.zeros((count, len(space.global_dof)))
    row = count - sum(len(axes) for _, axes in ways)
    for index, axes in ways:
        side = space.sides[index][0]
        own = side[side < space.size]
        free = own[space.gather[own] >= 0]
        traces[row: row + len(axes), own] = axes[:, space.dof[own] % 3]
        start[row: row + len(axes), space.gather[free]] = axes[:, space.dof[free] % 3]
        row += len(axes)
    whole, = space.extended(traces)
    return pairs.masked(-pairs.transfer.first(whole)), start


def _answered(d: Decomposition, lawful: Lawful, lifts: Mapping[int, np.ndarray], known: np.ndarray | None,
              count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, B) what the bodies do where supports move by lifts and soles hold the rest, (n,) its ‖·‖²_K, and (n, T) the work of the
    reactions to û − u."""
    space, requests = d.space, {}
    answered, energy, carried = np.zeros((count, len(space.global_dof))), np.zeros(count), np.zeros((count, d.steps))
    soles = None if known is None else space.loads(d.stage.direction.times(known))
    for e, (s, rim, trace) in enumerate(zip(d.own, d.made.rims, d.made.traces)):
        if s.index not in lifts:
            continue
        flat, full = lifts[s.index].reshape(count, -1), np.zeros((count, 3 * d.made.node_counts[e]))
        full[:, rim.dofs] = -(rim.stiffness @ flat[:, rim.dofs].T).T
        full[:, np.flatnonzero(s.fixed.ravel())] = 0.0
        if soles is not None:
            full[:, trace] -= soles[:, space.boundary[e]]
        if full.any():
            requests[e] = full
        carried += flat[:, rim.dofs] @ np.where(s.fixed.ravel()[rim.dofs, None], rim.stiffness @ lawful.beyond[e][:, rim.dofs].T, 0.0)
    for e, answer in d.blackbox.fields(requests).items():
        s, rim = d.own[e], d.made.rims[e]
        answered[:, space.boundary[e]] = answer[:, d.made.traces[e]]
        lift = lifts[s.index].reshape(count, -1)
        u = lift + answer[:, : lift.shape[1]]
        energy += dots(lift[:, rim.dofs], (rim.stiffness @ u[:, rim.dofs].T).T)
    pushed = space.trace(answered) if known is None else space.trace(answered) + known
    energy -= dots(answered, space.loads(d.stage.direction.times(pushed)))
    return answered, *space.team.sum(energy, carried)
