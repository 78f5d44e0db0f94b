"""Node pairs of interfaces that a law answers for, and where their traces are.

The diagonal search direction k⁺ has, at every pair, one stiffness along the normal and one across
it. Both sides get the mean of their own k⁻, so that β₁ = β₂ = ½ and keq = k⁺/2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.compiled import in_parts
from orchestrator.laws.base import Law
from orchestrator.laws.points import Answer, Points
from orchestrator.laws.status import Status, table
from orchestrator.method.interface import pair_loops
from orchestrator.method.interface.general_transfer import General
from orchestrator.method.interface.point_traces import GeneralTraces, NodeCompliance, PairTraces, inverses, search_stiffness
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.interface.transfer import Matching
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.mesh.patch import node_areas, node_normals
from orchestrator.scene.soles.nodal import stiffer

# Prescribed components are taken out of a normal that keeps this much of its length.
UPRIGHT = 1e-6


@dataclass
class Run:
    """Neighbouring interfaces of the same law, worked on as one.

    Parameters
    ----------
    law : its class
    part : which of the pairs
    points : geometry, search direction and the law's parameters
    """

    law: type[Law]
    part: slice
    points: Points


@dataclass
class Pairs:
    """All node pairs of a set of interfaces, interface after interface; those of perfect interfaces come last.

    Parameters
    ----------
    interfaces : the interfaces, in order
    bounds : (interfaces + 1,) int, where each one's pairs start
    transfer : between the sides, with points (3, P); none where prescribed. Some pairs of a general one have none
    free : (3, P) bool, components that are not prescribed
    runs : the laws and their points, in order
    mine : (P,) bool, pairs of interfaces whose first side is on this rank
    laws : all laws of the scene that have measures
    statuses : all that its laws know
    stabilisation : (P,) ε of every pair, see ``stabilisation``; None where contacts are not stabilised
    tied : (q,) int, this rank's trace dofs that follow the pairs' (see ``ties``), with targets (T, q) and k⁺
        tie_stiffness (q,)
    nodes : (k⁺)⁻¹ of all these interfaces, where the nodes of some do not match
    """

    interfaces: list[Interface]
    bounds: np.ndarray
    transfer: Matching | General | None
    free: np.ndarray
    runs: list[Run]
    mine: np.ndarray
    laws: list[type[Law]]
    statuses: list[Status]
    stabilisation: np.ndarray | None
    tied: np.ndarray
    targets: np.ndarray
    tie_stiffness: np.ndarray
    nodes: NodeCompliance | None = None

    def __len__(self) -> int:
        return len(self.mine)

    @cached_property
    def points(self) -> Points:
        """Geometry and search direction of all pairs."""
        own = [run.points for run in self.runs]
        if len(own) == 1:
            return own[0]
        none = Points(np.zeros((3, 0)), *np.zeros((3, 0)))
        return Points(*(np.concatenate([getattr(points, name) for points in [none, *own]], axis=-1)
                        for name in ("normal", "stiff_n", "stiff_t", "area")))

    def traces(self, w: np.ndarray, f: np.ndarray) -> PairTraces | GeneralTraces:
        """Traces (T, D + G) at the pairs."""
        return (PairTraces if self.nodes is None else GeneralTraces)(self, w, f)

    def responses(self, W: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What fields W, F (m, D + G) of the bodies change F by, those of the first sides and of the second: (m, 3, P) each."""
        if self.nodes is None:
            transfer, keq = self.transfer, self.points.stiffness
            return (0.5 * transfer.first(F) - keq(transfer.first(W)), keq(transfer.second(W)) - 0.5 * transfer.second(F))
        second = np.zeros(self.transfer.total, dtype=bool)
        for i in self.interfaces:
            second[self.transfer.sides[i.index][1]] = True
        return tuple(self.traces(np.where(side, W, 0.0), np.where(side, F, 0.0)).predicted() for side in (~second, second))

    def force(self, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
        """The laws' answer for the predicted forces F (3, P), each interface by its own law."""
        parts = [(run.part, run.law.force(run.points, F[:, run.part], previous[:, run.part], derivative))
                 for run in self.runs]
        if not parts:
            return _nothing(derivative)
        if len(parts) == 1 and self._all_free:
            return parts[0][1]
        force = np.where(self.free, np.concatenate([a.force for _, a in parts], axis=1), 0.0)
        answer = Answer(force, np.concatenate([a.status for _, a in parts]))
        if derivative:
            answer.active = np.concatenate([a.active + part.start for part, a in parts])
            free = self.free[:, answer.active]
            slope = np.concatenate([a.derivative for _, a in parts], axis=2)
            answer.derivative = np.where(free[:, None] & free, slope, 0.0)
        return answer

    def settled(self, lawful: np.ndarray, F: np.ndarray, previous: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(3, P) f̂ = (1 − ε) law(F) + ε (F − keq d_before), where anything is stabilised, and d = (F − f̂)/keq.

        Parameters
        ----------
        lawful : law(F); F, previous : as for ``force``
        """
        force, jump = np.empty_like(F), np.empty_like(F)
        epsilon = np.empty(0) if self.stabilisation is None else self.stabilisation
        in_parts(pair_loops.settled, len(self), self.free, *self.points.search, epsilon, F, previous,
                 np.ascontiguousarray(lawful), force, jump)
        return force, jump

    def resisted(self, F: np.ndarray, previous: np.ndarray) -> np.ndarray:
        """(3, P) F − keq d_before: the force that leaves pairs where they were at the end of the load step before."""
        return self.masked(F - self.points.stiffness(previous))

    def some(self, chosen: np.ndarray) -> Pairs:
        """Some of the pairs (Q,) int, ascending, of the same interfaces, without ties."""
        ends = np.searchsorted(chosen, [run.part.stop for run in self.runs]).tolist()
        runs = [Run(run.law, slice(a, b), run.points.some(chosen[a:b] - run.part.start))
                for run, a, b in zip(self.runs, [0, *ends], ends)]
        transfer = self.transfer.some(chosen) if self.nodes is None else None  # laws need none, and products are dear
        return replace(self, transfer=transfer, free=self.free[:, chosen], mine=self.mine[chosen], runs=runs,
                       bounds=np.searchsorted(chosen, self.bounds), stabilisation=_at(self.stabilisation, chosen),
                       tied=self.tied[:0], targets=self.targets[:, :0], tie_stiffness=self.tie_stiffness[:0])

    @cached_property
    def lawful(self) -> Pairs:
        """The pairs that are not perfect."""
        count = sum(not i.law.perfect for i in self.interfaces)
        if count == len(self.interfaces):
            return self
        first = np.arange(self.bounds[count])
        return replace(self, interfaces=self.interfaces[:count], bounds=self.bounds[: count + 1], free=self.free[:, first],
                       transfer=self.transfer.some(first), mine=self.mine[first], stabilisation=_at(self.stabilisation, first),
                       nodes=None if self.nodes is None else self.nodes.of_laws,
                       runs=[run for run in self.runs if not run.law.perfect])

    def idle(self, F: np.ndarray, change: np.ndarray) -> np.ndarray:
        """(P,) bool, pairs that carry no force while the normal part of F changes by at most ``change`` (P,)."""
        parts = [run.law.idle(run.points, F[:, run.part], change[run.part]) for run in self.runs]
        return np.concatenate([np.zeros(0, dtype=bool), *parts])

    def masked(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) values, zero where prescribed."""
        return x if self._all_free else np.where(self.free, x, 0.0)

    def batch(self, steps) -> Pairs:
        """The same pairs for some of the load steps, a slice or indices."""
        return replace(self, targets=self.targets[steps])

    @cached_property
    def _all_free(self) -> bool:
        return bool(self.free.all())


def _nothing(derivative: bool) -> Answer:
    """The answer of no pairs."""
    answer = Answer(np.zeros((3, 0)), np.zeros(0, int))
    if derivative:
        answer.active, answer.derivative = np.zeros(0, int), np.zeros((3, 3, 0))
    return answer


def _at(values: np.ndarray | None, chosen: np.ndarray) -> np.ndarray | None:
    return None if values is None else values[chosen]


def make_pairs(scene: Scene, space: TraceSpace, k: sp.csr_array, stabilisation: np.ndarray | None = None) -> Pairs:
    """Pairs of the interfaces that a rank touches, ordered by law.

    Parameters
    ----------
    k : (D + G, D + G) search direction k⁻, ghosts included
    stabilisation : (interfaces,) ε of every interface of the scene; default: none
    """
    here = set(space.subdomains)
    wanted = sorted((i for i in scene.interfaces if here.intersection(i.subdomains)),
                    key=lambda i: (i.law.perfect, i.law.name, i.index))
    one, two, free, normal, area, own = ([] for _ in range(6))
    for i in wanted:
        if i.mortar is not None:
            for found, value in zip((one, two, free, normal, area), _mortar_points(i)):
                found.append(value)
            own.append(i.law.parameters(i.mortar.points, np.ones(len(i.mortar)), i.mortar.area))
            continue
        sides = np.zeros((2, len(i.global_nodes), 3), dtype=int)
        for side in (0, 1):
            sides[side][i.free] = space.sides[i.index][side]
        points = scene.points(i)
        mobile = lawful_nodes(i)
        one.append(sides[0][mobile])
        two.append(sides[1][mobile])
        free.append(i.free[mobile])
        upright, length = pair_normals(points, i)
        normal.append(upright[mobile])
        area.append(point_areas(points, i)[mobile])
        own.append(i.law.parameters(mobile, length[mobile], area[-1]))
    bounds = np.cumsum([0] + [len(a) for a in area])
    mine = np.repeat([i.subdomains[0] in here for i in wanted], np.diff(bounds)).astype(bool)
    none = np.zeros((0, 3))  # a rank may have no such interface
    one, two, free, normal = (np.concatenate([none.astype(t), *x]) for x, t in (
        (one, int), (two, int), (free, bool), (normal, float)))
    transfer = Matching(*(np.ascontiguousarray(x.T) for x in (one, two)), space.size, len(space.owner), bounds,
                        np.ascontiguousarray(free.T))
    blocks = 0.5 * sum(transfer.node_blocks(k))
    # a missing component takes the mean of the others
    trace = np.trace(blocks, axis1=1, axis2=2) * 3 / np.maximum(free.sum(axis=1), 1)
    stiff_n = np.einsum("pi,pij,pj->p", normal, blocks, normal)
    stiff_n = np.where(free.all(axis=1), stiff_n, np.maximum(stiff_n, trace / 3))
    stiff_t = (trace - stiff_n) / 2
    points = Points(np.ascontiguousarray(normal.T), stiff_n / 2, stiff_t / 2, np.concatenate([none[:, 0], *area]))
    nodes, exists = None, transfer.exists
    if isinstance(space.transfer, General):
        transfer, exists, nodes = _general(scene, space, k, wanted, transfer, points)
    if stabilisation is not None:  # on all ranks, or on none
        stabilisation = _beside_laws(stabilisation, scene, wanted, bounds, points) if stabilisation.any() else None
    laws = sorted({type(i.law) for i in scene.interfaces}, key=lambda law: law.name)
    ties = (space.ties.dofs, space.ties.targets, space.ties.stiffness) if space.ties else \
        (np.empty(0, int), np.empty((scene.steps, 0)), np.empty(0))
    return Pairs(wanted, bounds, transfer, exists, _runs(wanted, bounds, points, own), mine,
                 [law for law in laws if law.measures], table(laws), stabilisation, *ties, nodes)


def _mortar_points(interface: Interface) -> tuple[np.ndarray, ...]:
    """Of an interface whose nodes do not match: no trace dofs of pairs (p, 3) twice, nor free ones, normals and areas."""
    mortar = interface.mortar
    nowhere = np.zeros((len(mortar), 3), dtype=int)
    return nowhere, nowhere, nowhere.astype(bool), mortar.normal, mortar.area


def _general(scene: Scene, space: TraceSpace, k: sp.csr_array, interfaces: list[Interface], matching: Matching,
             points: Points) -> tuple[General, np.ndarray, NodeCompliance]:
    """The transfer at the points, which components they have, and (k⁺)⁻¹; sets the search direction of points whose nodes
    do not match.

    Parameters
    ----------
    interfaces : in the order of the points; matching : pairs of those whose nodes match; points : of all
    """
    flat, rows, mortars = space.transfer, np.full(matching.one.shape, -1), []
    dofs: list[tuple] = []
    held = space.held_everywhere
    for i, a, b in zip(interfaces, matching.bounds[:-1], matching.bounds[1:]):
        start, lawful = flat.bounds[i.index], not i.law.perfect
        if i.mortar is None:
            number = np.full(i.free.shape, -1)
            number[i.free] = start + np.arange(i.free.sum())
            rows[:, a:b] = number[lawful_nodes(i)].T
            part = points.some(slice(a, b))
            half = part.compliance(np.repeat(np.eye(3)[:, :, None], b - a, axis=2)).transpose(2, 0, 1) / 2
            there = matching.exists[:, a:b].T
            half = np.where(there[:, :, None] & there[:, None, :], half, 0.0)
            for side in (matching.one, matching.two):
                dofs.append((side[:, a:b].T, half, there, lawful))
        else:
            mortars.append(slice(int(a), int(b)))
            rows[:, a:b] = start + np.arange(3 * (b - a)).reshape(-1, 3).T
            for side, own in enumerate(space.sides[i.index]):
                at = own.reshape(-1, 3)
                if lawful:  # mid-edge nodes are tied
                    triangles = i.triangles if side == 0 else i.mortar.triangles
                    at = at[np.unique(triangles[:, :3])]
                row, column = np.repeat(at[:, :, None], 3, axis=2), np.repeat(at[:, None, :], 3, axis=1)
                stiffness = np.asarray(k[row.ravel(), column.ravel()]).reshape(-1, 3, 3)
                dofs.append((at, inverses(stiffness, ~held[at]), np.ones(at.shape, bool), lawful))
    transfer = flat.at(rows, matching.bounds)
    nodes = NodeCompliance.of_interfaces(dofs, len(space.owner))
    nodes.coupling = S = sp.csr_array(transfer.B @ nodes.compliance @ transfer.B.T)
    lawful = _components(np.arange(matching.bounds[sum(not i.law.perfect for i in interfaces)]), rows.shape[1])
    nodes.of_laws.coupling = sp.csr_array(S[lawful][:, lawful])
    if mortars:
        chosen = np.concatenate([np.arange(part.start, part.stop) for part in mortars])
        at = _components(chosen, rows.shape[1])
        ends = np.cumsum([0] + [part.stop - part.start for part in mortars])
        points.stiff_n[chosen], points.stiff_t[chosen] = search_stiffness(
            sp.csr_array(S[at][:, at]), points.normal[:, chosen],
            [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])])
    return transfer, transfer.exists, nodes


def _components(points: np.ndarray, count: int) -> np.ndarray:
    """(3 R,) where components of some points (R,) are in (3, count), flat."""
    return (np.arange(3)[:, None] * count + points).ravel()


def _beside_laws(stabilisation: np.ndarray, scene: Scene, wanted: list[Interface], bounds: np.ndarray,
                 points: Points) -> np.ndarray:
    """(P,) ε of every pair: its spring ε keq is to be weak beside the law's own, which may be softer than keq, and no
    stiffer where soles are made ``stiffer`` at single nodes."""
    each, rigidity = (np.repeat(x, np.diff(bounds)) for x in (
        stabilisation[[i.index for i in wanted]], np.array([i.law.rigidity for i in wanted])))
    for i, start, end in zip(wanted, bounds[:-1], bounds[1:]):
        if i.matching and not i.law.perfect:
            each[start:end] /= stiffer(scene, i, 0)[lawful_nodes(i)]
    return each * np.minimum(1.0, rigidity * points.area / points.stiff_n)


def _runs(interfaces: list[Interface], bounds: np.ndarray, points: Points, own: list[dict]) -> list[Run]:
    """The interfaces' points joined, law after law; ``own`` has the laws' parameters, interface by interface."""
    laws, runs, start = [type(i.law) for i in interfaces], [], 0
    for end, law in enumerate(laws, 1):
        if end == len(laws) or laws[end] is not law:
            part = slice(int(bounds[start]), int(bounds[end]))
            joined = {name: np.concatenate([values[name] for values in own[start:end]], axis=-1) for name in own[start]}
            runs.append(Run(law, part, replace(points.some(part), own=joined)))
            start = end
    return runs


def lawful_nodes(interface: Interface) -> np.ndarray:
    """(p,) int, ascending, which of an interface's nodes a law answers for: not those that are prescribed altogether, not
    mid-edge nodes that are tied, and where nodes do not match those that carry points."""
    if interface.mortar is not None:
        return interface.mortar.points
    mobile = interface.free.any(axis=1)
    if not interface.law.perfect:
        mobile &= np.isin(np.arange(len(mobile)), interface.corners)
    return np.flatnonzero(mobile)


def pair_normals(points: np.ndarray, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) from side 1 to side 2 within the components that are free, and the length (n,) left of each.

    What is prescribed on both sides neither opens nor slips: the law lives on the other components, where only
    that part of the pressure is felt, so that a gap and a friction coefficient grow by 1/length. At the rim of a
    symmetric half the facets' mean normal leans off the plane of symmetry; the true normal does not. Where the
    normal itself is prescribed it stays what it is: nothing presses. Where nodes do not match all components of points are
    free.
    """
    if interface.mortar is not None:
        normal = node_normals(points, interface.triangles)
        normal[interface.mortar.points] = interface.mortar.normal
        return normal, np.ones(len(normal))
    normal = node_normals(points, interface.triangles) if interface.normals is None else interface.normals
    inside = np.where(interface.free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1)
    length = np.where((length > UPRIGHT) & ~interface.free.all(axis=1), length, 1.0)
    return np.where((length < 1.0)[:, None], inside / length[:, None], normal), length


def point_areas(points: np.ndarray, interface: Interface) -> np.ndarray:
    """(n,) a third of the area of the facets around each corner; none for mid-edge nodes, which are tied. Where nodes do
    not match that of the points; none for other nodes, whose share they have."""
    if interface.mortar is not None:
        area = np.zeros(len(points))
        area[interface.mortar.points] = interface.mortar.area
        return area
    return node_areas(points, interface.triangles)
