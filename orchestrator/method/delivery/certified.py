"""The intervals that the energy error gives for what is asked, see ``stopping.intervals``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.lawful import Lawful
from orchestrator.method.delivery.flux import Measured
from orchestrator.method.delivery.wanted import Wanted
from orchestrator.method.iterated import Iterated
from orchestrator.method.interface.rows import dots
from orchestrator.method.stopping.dual_energy import CANCELLED
from orchestrator.method.stopping.influence import Asked, InfluenceFields
from orchestrator.method.stopping.intervals import PointLoads, of_displacements, of_forces

NOTHING = 1e-12  # work in rigid motions, over the largest of that of all its parts, that is rounding


@dataclass(frozen=True)
class Intervals:
    """Least and greatest values, T load steps; infinite where the error says nothing.

    guaranteed : whether they are
    probes : name → (T, c, 2) components of displacement, stress, or force and moment, see ``flux``
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
    """Motions of a support, or of side 1 of an interface, that ask for its forces: m unit motions a + b × (x − c).

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
              reactions: np.ndarray, resultants: Resultants, carried: Mapping[str, np.ndarray]) -> Intervals:
    """The intervals that are wanted.

    continuous : per own subdomain (T, n_E, 3) v
    reactions, resultants : of û and λ̂, of all ranks; the first without what supports take of the rest
    carried : name of a probe of forces → (T, c) what they are of û
    """
    probes = _displacements(d, iterated, lawful, wanted.probes, continuous) if wanted.probes else {}
    supports = [Way.rigid(entry, wanted.about, wanted.length) for entry in wanted.entries]
    cuts = [Way.rigid(i, resultants.centre[i], wanted.length) for i in wanted.interfaces]
    bolts = [Way(i, axis[None], np.zeros((1, 3)), np.zeros(3)) for i, axis in wanted.bolts.values()]
    asked = (*supports, *wanted.forces.values(), *cuts, *bolts)
    ends = np.cumsum([0] + [len(way) for way in asked])
    far = _forces(d, lawful, supports, wanted, [*cuts, *bolts]) if ends[-1] else np.zeros((0, d.steps, 2))
    far = [far[a:b].transpose(1, 0, 2) for a, b in zip(ends[:-1], ends[1:])]  # (T, m, 2)
    unit = np.repeat([1.0, wanted.length], 3)[:, None]  # of forces and moments over those of the motions
    supported, moment = None, reactions[:, :, 3:] - np.cross(wanted.about, reactions[:, :, :3])
    if wanted.reactions:
        supported = np.repeat(np.concatenate([reactions[:, :, :3], moment], axis=2)[..., None], 2, axis=3)
    for way, own in zip(supports, far):
        supported[way.number] += unit * own
    far = far[len(supports):]
    probes |= {name: carried[name][..., None] + own for name, own in zip(wanted.forces, far)}
    far = far[len(wanted.forces):]
    whole = np.concatenate([resultants.force, resultants.moment], axis=2)
    between = {way.number: whole[:, way.number, :, None] + unit * own for way, own in zip(cuts, far)}
    pulls = {name: (resultants.force[:, way.number] @ way.axes[0])[:, None] + own[:, 0]
             for name, way, own in zip(wanted.bolts, bolts, far[len(cuts):])}
    return Intervals(not np.isnan(lawful.judged.factor), probes, supported, between, resultants.centre, pulls)


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
        resultants.append(np.where(np.abs(work) > NOTHING * most.max(axis=1, keepdims=True, initial=0.0), work, 0.0) @ lawful.certificate.forces.R[e])
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


def _forces(d: Decomposition, lawful: Lawful, supports: Sequence[Way], wanted: Wanted, cuts: Sequence[Way]) -> np.ndarray:
    """(n, T, 2) how far forces of supports, through matter, and of interfaces are from those of û and λ̂; n motions in all."""
    space, team, certificate, through = d.space, d.space.team, lawful.certificate, list(wanted.forces.values())
    held = sum(map(len, supports))
    moving = held + sum(map(len, through))
    count = moving + sum(map(len, cuts))
    lifts = _lifts(d, supports, count)
    rest = np.zeros((count, 0, 3))  # of those that nothing holds, and of other ranks'
    known = space.known([SimpleNamespace(prescribed=lifts.get(e, rest)) for e in range(len(d.scene.subdomains))])
    anywhere, = team.max(float(known is not None))
    if anywhere and known is None:
        known = np.zeros((count, space.size))
    starts = held + np.cumsum([0, *map(len, through)])
    parted = [_Moved(row, rim.interface, rim.side, rim.nodes, -rim.motions) for name, row in zip(wanted.forces, starts)
              for rim in wanted.rims.get(name, ())]
    row = moving
    for way in cuts:
        nodes = np.arange(len(d.scene.interfaces[way.number].nodes[0]))
        parted.append(_Moved(row, way.number, 0, nodes, way.at(d.scene.side_points(d.scene.interfaces[way.number], 0))))
        row += len(way)
    jump, start = _parted(d, lawful, parted, count)
    answered, energy, carried = _answered(d, lawful, *_strained(d, lifts, through, held, count), known)
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


@dataclass(frozen=True)
class _Moved:
    """Motions of one side of an interface, beside which all else rests: m rows of those asked for, from one on.

    nodes : (k,) int, those of the side that move; motions : (m, k, 3)
    """

    row: int
    interface: int
    side: int
    nodes: np.ndarray
    motions: np.ndarray


def _parted(d: Decomposition, lawful: Lawful, moved: Sequence[_Moved], count: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3, P) jumps, and (n, B) boundary values that have them."""
    space, pairs = d.space, lawful.certificate.pairs
    traces, start = np.zeros((count, space.size)), np.zeros((count, len(space.global_dof)))
    for one in moved:
        i, side = d.scene.interfaces[one.interface], space.sides[one.interface][one.side]
        if not len(side):
            continue  # other ranks'
        traced = i.traced(one.side)
        motions = np.zeros((len(one.motions), *traced.shape))
        motions[:, one.nodes] = one.motions
        rows, motions = slice(one.row, one.row + len(motions)), motions[:, traced]
        own = side < space.size
        side, motions = side[own], motions[:, own]
        free = space.gather[side] >= 0
        traces[rows, side] += motions
        start[rows, space.gather[side[free]]] = motions[:, free]
    whole, = space.extended(traces)
    return pairs.masked(pairs.transfer.jump(whole)), start


def _strained(d: Decomposition, lifts: Mapping[int, np.ndarray], through: Sequence[Measured], held: int,
              count: int) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Own subdomain → (n, 3 n_E) K χ of supports' lifts, and of the tets that carry forces, and (n,) this rank's share of ‖χ‖²_K.

    held : how many of the n motions are supports'
    """
    strained, energy = {}, np.zeros(count)
    for s, rim in zip(d.own, d.made.rims):
        pushed = np.zeros((count, len(s.nodes), 3))
        if s.index in lifts:
            lift = lifts[s.index].reshape(count, -1)[:, rim.dofs]
            pushed.reshape(count, -1)[:, rim.dofs] = (rim.stiffness @ lift.T).T
            energy += dots(lift, pushed.reshape(count, -1)[:, rim.dofs])
        row = held
        for probe in through:
            if s.index in probe.weights:
                nodes, weight = probe.weights[s.index]
                np.add.at(pushed[row: row + len(probe)], (slice(None), nodes), weight)
            row += len(probe)
        if pushed.any():
            strained[s.index] = pushed.reshape(count, -1)
    if d.space.team.rank == 0 and through:
        energy[held: held + sum(map(len, through))] = np.concatenate([probe.energy for probe in through])
    return strained, energy


def _answered(d: Decomposition, lawful: Lawful, strained: Mapping[int, np.ndarray], energy: np.ndarray,
              known: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, B) what the bodies do under −K χ where soles hold the rest, (n,) ‖·‖²_K of both, and (n, T) the work of K χ in û − u.

    strained, energy : K χ and this rank's share of ‖χ‖²_K; known : (n, D) traces of χ, None where there are none
    """
    space, requests, count, begun = d.space, {}, len(energy), energy
    answered, carried = np.zeros((count, len(space.global_dof))), np.zeros((count, d.steps))
    soles = None if known is None else space.loads(d.stage.direction.times(known))
    for e, (s, trace) in enumerate(zip(d.own, d.made.traces)):
        full, size = np.zeros((count, 3 * d.made.node_counts[e])), 3 * len(s.nodes)
        if s.index in strained:
            full[:, :size] = np.where(s.fixed.ravel(), 0.0, -strained[s.index])
            carried += strained[s.index] @ lawful.beyond[e].T
        if soles is not None:
            full[:, trace] -= soles[:, space.boundary[e]]
        if full.any():
            requests[e] = full
    for e, answer in d.blackbox.fields(requests).items():
        s = d.own[e]
        answered[:, space.boundary[e]] = answer[:, d.made.traces[e]]
        if s.index in strained:
            energy = energy + dots(strained[s.index], answer[:, : 3 * len(s.nodes)])
    energy = energy - dots(answered, d.stage.direction.robin(answered, known))
    begun, energy, carried = space.team.sum(begun, energy, carried)
    return answered, np.maximum(energy, 0.0) + CANCELLED * begun, carried
