"""The node pairs of a rank's interfaces: their places, search direction, law's parameters, ε of stabilisation.

The diagonal search direction k⁺ has, at every pair, one stiffness along the normal and one across
it. Both sides get the mean of their own k⁻, so that β₁ = β₂ = ½ and keq = k⁺/2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Points
from orchestrator.laws.status import table
from orchestrator.method.interface.general_transfer import General
from orchestrator.method.interface.pair_geometry import lawful_nodes, pair_areas, pair_normals
from orchestrator.method.interface.pairs import Pairs, Run
from orchestrator.method.interface.node_compliance import NodeCompliance, inverses, search_stiffness
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.interface.transfer import Matching
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.soles.nodal import stiffer


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
            own.append(_parameters(i, i.mortar.points, np.ones(len(i.mortar)), i.mortar.area))
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
        area.append(pair_areas(points, i)[mobile])
        own.append(_parameters(i, mobile, length[mobile], area[-1]))
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
                 [law for law in laws if law.measures], table(laws), stabilisation, *ties, np.arange(scene.steps), nodes)


def _mortar_points(interface: Interface) -> tuple[np.ndarray, ...]:
    """Of an interface whose nodes do not match: no trace dofs of pairs (p, 3) twice, nor free ones, normals and areas."""
    mortar = interface.mortar
    nowhere = np.zeros((len(mortar), 3), dtype=int)
    area = np.where(mortar.carrying, mortar.area, mortar.area.max(initial=0.0) or 1.0)  # pressures of what carries nothing are zero
    return nowhere, nowhere, nowhere.astype(bool), mortar.normal, area


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
            rows[:, a:b] = np.where(i.mortar.carrying, start + np.arange(3 * (b - a)).reshape(-1, 3).T, -1)
            for side, own in enumerate(space.sides[i.index]):
                at = own.reshape(-1, 3)
                if i.tied:  # mid-edge nodes follow their corners
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
        gives = nodes.compliance.diagonal()
        points.stiff_n[chosen], points.stiff_t[chosen] = search_stiffness(
            sp.csr_array(S[at][:, at]), points.normal[:, chosen], [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:])],
            2 * float(gives.sum() / max(np.count_nonzero(gives), 1)) or 1.0)
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
            constant, stepped = ([values[k] for values in own[start:end]] for k in (0, 1))
            joined = {name: np.concatenate([values[name] for values in constant], axis=-1) for name in constant[0]}
            moving = {name: _over_steps([(values.get(name), same[name]) for values, same in zip(stepped, constant)])
                      for name in constant[0] if any(name in values for values in stepped)}
            numbers = np.repeat([i.index for i in interfaces[start:end]], np.diff(bounds[start:end + 1]))
            runs.append(Run(law, part, replace(points.some(part), own=joined, stepped=moving, interface=numbers)))
            start = end
    return runs


def _parameters(interface: Interface, *at: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The parameters of an interface's law at its points, and those that differ between load steps at all of them (T, …, P)."""
    each = [law.parameters(*at) for law in interface.law_at_steps]
    stepped = {name: np.stack([values[name] for values in each]) for name in (each[0] if each else ())}
    return interface.law.parameters(*at), {name: v for name, v in stepped.items() if (v != v[:1]).any()}


def _over_steps(parts: list[tuple[np.ndarray | None, np.ndarray]]) -> np.ndarray:
    """(T, …, P) of interfaces one after the other; what does not differ between load steps (…, P) is the same at all."""
    steps = next(len(values) for values, _ in parts if values is not None)
    return np.concatenate([np.broadcast_to(same, (steps, *same.shape)) if values is None else values
                           for values, same in parts], axis=-1)
