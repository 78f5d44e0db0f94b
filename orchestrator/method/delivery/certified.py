"""The intervals that the energy error gives for what is asked, see ``stopping.intervals``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.lawful import Lawful
from orchestrator.method.delivery.wanted import Measured, Wanted
from orchestrator.method.iterated import Iterated
from orchestrator.method.interface.rows import dots
from orchestrator.method.stopping.influence import Asked, InfluenceFields
from orchestrator.method.stopping.intervals import PointLoads, of_displacements, of_forces

NOTHING = 1e-12  # work in rigid motions, over that of all its parts, that is rounding


@dataclass(frozen=True)
class Intervals:
    """Least and greatest values, T load steps; infinite where the error says nothing.

    guaranteed : whether they are
    probes : name → (T, c, 2) components of displacement or stress
    reactions : (entries, T, 6, 2) forces and moments, None where nobody asks
    interfaces : number of the interface → (T, 6, 2) force of side 2 on side 1, and its moment
    centre : (I, 3) what interfaces' moments are about
    bolts : name → (T, 2)
    """

    guaranteed: bool
    probes: dict[str, np.ndarray]
    reactions: np.ndarray | None
    interfaces: dict[int, np.ndarray]
    centre: np.ndarray
    bolts: dict[str, np.ndarray]


@dataclass(frozen=True)
class Way:
    """What a support, or side 1 of an interface, is moved by to ask for its forces: m unit motions a + b × (x − c).

    number : of the entry of ``boundary``, or of the interface
    axes, turns : (m, 3) a, and b, one over a length; about : (3,) c
    """

    number: int
    axes: np.ndarray
    turns: np.ndarray
    about: np.ndarray

    @classmethod
    def rigid(cls, number: int, about: np.ndarray, length: float) -> Way:
        """Three translations, and three rotations that move what is at a distance of ``length`` as far."""
        nothing = np.zeros((3, 3))
        return cls(number, np.vstack([np.eye(3), nothing]), np.vstack([nothing, np.eye(3) / length]), about)

    def __len__(self) -> int:
        return len(self.axes)

    def at(self, points: np.ndarray) -> np.ndarray:
        """(m, n, 3) at points (n, 3)."""
        return self.axes[:, None] + np.cross(self.turns[:, None], points - self.about)


def intervals(d: Decomposition, iterated: Iterated, lawful: Lawful, wanted: Wanted, continuous: Sequence[np.ndarray | None],
              reactions: np.ndarray, resultants: Resultants) -> Intervals:
    """Those that are wanted.

    continuous : per own subdomain (T, n_E, 3) v
    reactions, resultants : of û and λ̂, of all ranks; the first without what supports take of the rest
    """
    probes = _displacements(d, iterated, lawful, wanted.probes, continuous) if wanted.probes else {}
    supports = [Way.rigid(entry, wanted.about, wanted.length) for entry in wanted.entries]
    cuts = [Way.rigid(i, resultants.centre[i], wanted.length) for i in wanted.interfaces]
    bolts = [Way(i, axis[None], np.zeros((1, 3)), np.zeros(3)) for i, axis in wanted.bolts.values()]
    ends = np.cumsum([0] + [len(way) for way in (*supports, *cuts, *bolts)])
    far = _forces(d, lawful, supports, [*cuts, *bolts]) if ends[-1] else np.zeros((0, d.steps, 2))
    far = [far[a:b].transpose(1, 0, 2) for a, b in zip(ends[:-1], ends[1:])]  # (T, m, 2)
    unit = np.repeat([1.0, wanted.length], 3)[:, None]  # of forces and moments over those of the motions
    supported, moment = None, reactions[:, :, 3:] - np.cross(wanted.about, reactions[:, :, :3])
    if wanted.reactions:
        supported = np.repeat(np.concatenate([reactions[:, :, :3], moment], axis=2)[..., None], 2, axis=3)
    for way, own in zip(supports, far):
        supported[way.number] += unit * own
    far = far[len(supports):]
    whole = np.concatenate([resultants.force, resultants.moment], axis=2)
    carried = {way.number: whole[:, way.number, :, None] + unit * own for way, own in zip(cuts, far)}
    pulls = {name: (resultants.force[:, way.number] @ way.axes[0])[:, None] + own[:, 0]
             for name, way, own in zip(wanted.bolts, bolts, far[len(cuts):])}
    return Intervals(not np.isnan(lawful.judged.factor), probes, supported, carried, resultants.centre, pulls)


def _displacements(d: Decomposition, iterated: Iterated, lawful: Lawful, probes: Mapping[str, Measured],
                   continuous: Sequence[np.ndarray | None]) -> dict[str, np.ndarray]:
    space, team = d.space, d.space.team
    ends = np.cumsum([0] + [probe.given.shape[1] for probe in probes.values()])
    count = int(ends[-1])
    boundary, moved, energy = *np.zeros((2, count, len(space.global_dof))), np.zeros(count)
    value, requests, resultants = np.zeros((count, d.steps)), {}, []
    for e, s in enumerate(d.own):
        q = np.zeros((count, len(s.nodes), 3))
        for probe, a, b in zip(probes.values(), ends[:-1], ends[1:]):
            if s.index in probe.weights:
                nodes, weight = probe.weights[s.index]
                np.add.at(q[a:b], (slice(None), nodes), weight)
        value += np.einsum("qni,tni->qt", q, continuous[s.index])
        q = np.where(s.fixed, 0.0, q).reshape(count, -1)  # what is prescribed is known
        work, most = (of(q) @ of(d.made.modes[e]) for of in (np.asarray, np.abs))
        # stresses need no other body to be in balance: what rounding leaves of that is nothing
        resultants.append(np.where(np.abs(work) > NOTHING * most, work, 0.0) @ lawful.certificate.forces.R[e])
        boundary[:, space.boundary[e]] = q[:, d.made.traces[e]]
        if q.any():
            requests[e] = np.hstack([q, np.zeros((count, 3 * d.made.node_counts[e] - q.shape[1]))])
    for e, answer in d.blackbox.fields(requests).items():
        moved[:, space.boundary[e]] = answer[:, d.made.traces[e]]
        energy += dots(requests[e], answer)
    energy, value = team.sum(energy, value)
    found = of_displacements(lawful.certificate, iterated.fields, lawful.judged, PointLoads(boundary, moved, energy, resultants))
    found = (value[:, :, None] + found).transpose(1, 0, 2)
    return {name: probe.given[:, :, None] + found[:, a:b] for (name, probe), a, b in zip(probes.items(), ends[:-1], ends[1:])}


def _forces(d: Decomposition, lawful: Lawful, supports: Sequence[Way], cuts: Sequence[Way]) -> np.ndarray:
    """(n, T, 2) how far forces of supports, then of interfaces, are from those of û and λ̂; n motions in all."""
    space, team, certificate = d.space, d.space.team, lawful.certificate
    moving = sum(map(len, supports))
    count = moving + sum(map(len, cuts))
    lifts = _lifts(d, supports, count)
    rest = np.zeros((count, 0, 3))  # of those that nothing holds, and of other ranks'
    known = space.known([SimpleNamespace(prescribed=lifts.get(e, rest)) for e in range(len(d.scene.subdomains))])
    anywhere, = team.max(float(known is not None))
    if anywhere and known is None:
        known = np.zeros((count, space.size))
    jump, start = _parted(d, lawful, cuts, count)
    answered, energy, carried = _answered(d, lawful, lifts, known, count)
    influence = InfluenceFields(certificate, Asked(jump, start, known, answered, energy, np.arange(count) < moving))()
    return of_forces(certificate, lawful.judged, influence, carried, lawful.rest)


def _lifts(d: Decomposition, supports: Sequence[Way], count: int) -> dict[int, np.ndarray]:
    """Own subdomain → (n, n_E, 3) unit motions of the supports of entries, those that there are."""
    lifts = {}
    for s in d.own:
        if s.fixed.any():
            lift, row = np.zeros((count, len(s.nodes), 3)), 0
            for way in supports:
                lift[row: row + len(way)] = way.at(d.scene.mesh.nodes[s.nodes]) * (s.fixed & (s.held_by == way.number))
                row += len(way)
            lifts[s.index] = lift
    return lifts


def _parted(d: Decomposition, lawful: Lawful, cuts: Sequence[Way], count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, P) jumps, and (n, B) boundary values that have them: side 1 of an interface moves, all else rests."""
    space, pairs = d.space, lawful.certificate.pairs
    traces, start = np.zeros((count, space.size)), np.zeros((count, len(space.global_dof)))
    row = count - sum(map(len, cuts))
    for way in cuts:
        side = space.sides[way.number][0]
        own = side[side < space.size]
        free = own[space.gather[own] >= 0]
        for at, into, to in ((own, traces, own), (free, start, space.gather[free])):
            node, component = np.divmod(space.dof[at], 3)
            into[row: row + len(way), to] = way.at(d.scene.mesh.nodes[node])[:, np.arange(len(at)), component]
        row += len(way)
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
