"""The points of a rank's interfaces: their places, search direction, law's parameters, ε of stabilisation.

The diagonal search direction k⁺ has, at every pair of nodes, one stiffness along the normal and one across it. Both sides get
the mean of their own k⁻, so that keq = k⁺/2. Where nodes do not match, k⁺ is each node's own 3 × 3 block of k⁻.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from orchestrator.laws.points import Points
from orchestrator.method.interface.pair_geometry import lawful_nodes, pair_areas, pair_normals
from orchestrator.method.interface.pairs import Pairs, Run
from orchestrator.method.interface.point_traces import NodeCompliance
from orchestrator.method.interface.ties import Prescribed
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.interface.transfer import Transfer
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.soles.nodal import stiffer

# λ is known to a hundredth: what a step may overshoot by costs nothing.
KNOWN = 1e-2


def make_pairs(scene: Scene, space: TraceSpace, k: sp.csr_array, stabilisation: np.ndarray | None = None) -> Pairs:
    """Points of the interfaces that a rank touches, ordered by law.

    Parameters
    ----------
    k : (D + G, D + G) search direction k⁻, ghosts included
    stabilisation : (interfaces,) ε of every interface of the scene; default: none
    """
    here = set(space.subdomains)
    wanted = sorted((i for i in scene.interfaces if here.intersection(i.subdomains)),
                    key=lambda i: (i.law.perfect, i.law.name, i.index))
    rows, normal, area, own = [np.empty((0, 3), int)], [np.empty((0, 3))], [np.empty(0)], []  # a rank may have no such interface
    for i in wanted:
        where, chosen = scene.points(i), lawful_nodes(i)
        upright, length = pair_normals(where, i)
        share = pair_areas(where, i)[chosen]
        own.append(_parameters(i, chosen, length[chosen], share))
        rows.append(_numbers(space.transfer, i, chosen))
        normal.append(upright[chosen])
        area.append(np.where(share > 0, share, share.max(initial=0.0) or 1.0))  # pressures of what carries nothing are zero
    bounds = np.cumsum([0] + [len(a) for a in area[1:]])
    transfer = space.transfer.at(np.ascontiguousarray(np.concatenate(rows).T), bounds)
    points = Points(np.ascontiguousarray(np.concatenate(normal).T), *np.ones((2, bounds[-1])), np.concatenate(area))
    nodes = _search_direction(space, k, wanted, transfer, points)
    if stabilisation is not None:  # on all ranks, or on none
        stabilisation = _beside_laws(stabilisation, scene, wanted, bounds, points) if stabilisation.any() else None
    mine = np.repeat([i.subdomains[0] in here for i in wanted], np.diff(bounds)).astype(bool)
    laws = sorted({type(i.law) for i in scene.interfaces}, key=lambda law: law.name)
    return Pairs(wanted, transfer, nodes, _runs(wanted, bounds, points, own), mine, laws, stabilisation,
                 space.ties.prescribed if space.ties else Prescribed.nothing(scene.steps), np.arange(scene.steps))


def _numbers(transfer: Transfer, interface: Interface, chosen: np.ndarray) -> np.ndarray:
    """(p, 3) int, which flat points of the scene the components of an interface's points are, −1 for none."""
    start = transfer.bounds[interface.index]
    if interface.mortar is not None:
        return np.where(interface.mortar.carrying[:, None], start + np.arange(3 * len(chosen)).reshape(-1, 3), -1)
    number = np.full(interface.free.shape, -1)
    number[interface.free] = start + np.arange(interface.free.sum())
    return number[chosen]


def _search_direction(space: TraceSpace, k: sp.csr_array, interfaces: list[Interface], transfer: Transfer,
                      points: Points) -> NodeCompliance:
    """Sets the stiffness keq of points; returns C = (k⁺)⁻¹ of their nodes."""
    bounds, held = transfer.bounds, None if transfer.picks else space.held_everywhere  # all ranks ask
    at_mortars = np.repeat([i.mortar is not None for i in interfaces], np.diff(bounds)).astype(bool)
    pair = np.flatnonzero(~at_mortars)
    one, two = (np.ascontiguousarray(side[:, pair].T) for side in (transfer.one, transfer.two))
    normal, there = points.normal[:, pair].T, one >= 0
    blocks = 0.5 * (_node_blocks(k, one) + _node_blocks(k, two))
    # a missing component takes the mean of the others
    trace = np.trace(blocks, axis1=1, axis2=2) * 3 / np.maximum(there.sum(axis=1), 1)
    along = np.einsum("pi,pij,pj->p", normal, blocks, normal)
    along = np.where(there.all(axis=1), along, np.maximum(along, trace / 3))
    points.stiff_n[pair], points.stiff_t[pair] = along / 2, (trace - along) / 4
    half = points.some(pair).compliance(np.repeat(np.eye(3)[:, :, None], len(pair), axis=2)).transpose(2, 0, 1) / 2
    nodes = [(one, half), (two, half)]
    for i in interfaces:
        if i.mortar is not None:
            for side, own in enumerate(space.sides[i.index]):
                at = own.reshape(-1, 3)
                if i.tied:  # mid-edge nodes follow their corners
                    at = at[np.unique(i.triangles_on(side)[:, :3])]
                nodes.append((at, _inverses(_node_blocks(k, at), ~held[at])))
    result = NodeCompliance.of(nodes, transfer)
    if at_mortars.any():
        gives = result.compliance.diagonal()
        usual = 2 * float(gives.sum() / max(np.count_nonzero(gives), 1)) or 1.0
        parts = [np.arange(a, b) for i, a, b in zip(interfaces, bounds[:-1], bounds[1:]) if i.mortar is not None]
        search_stiffness(result.coupling, points, parts, usual)
    return result


def _node_blocks(matrix: sp.csr_array, dofs: np.ndarray) -> np.ndarray:
    """(n, 3, 3) diagonal blocks of a matrix at nodes with dofs (n, 3); zero where there is none, −1."""
    if not len(dofs):
        return np.zeros((0, 3, 3))
    row, column = np.repeat(dofs[:, :, None], 3, axis=2), np.repeat(dofs[:, None, :], 3, axis=1)
    values = np.asarray(matrix[row.ravel(), column.ravel()]).reshape(-1, 3, 3)
    return np.where((row >= 0) & (column >= 0), values, 0.0)


def _inverses(blocks: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(n, 3, 3) inverses of symmetric blocks on the components that are free, (n, 3) bool; zero on the others."""
    both = free[:, :, None] & free[:, None, :]
    held = np.where(free, 0.0, 1.0)[:, :, None] * np.eye(3)
    return np.where(both, np.linalg.inv(np.where(both, blocks, 0.0) + held), 0.0)


def search_stiffness(S: sp.csr_array, points: Points, parts: Sequence[np.ndarray], usual: float) -> None:
    """Sets keq along the normal and across it, from S (3P, 3P), so that keq S has no eigenvalue above 1 on any part.

    Parameters
    ----------
    parts : points of each interface whose nodes do not match: one eigenvalue for each
    usual : compliance of points where none carries anything, as of sides that have slid off each other
    """
    for at in parts:
        dofs = (np.arange(3)[:, None] * len(points) + at).ravel()
        own, normal, count = sp.csr_array(S[dofs][:, dofs]), points.normal[:, at], len(at)
        blocks = _node_blocks(own, np.arange(3 * count).reshape(3, -1).T)
        along = np.einsum("ip,pij,jp->p", normal, blocks, normal)
        across = (np.trace(blocks, axis1=1, axis2=2) - along) / 2
        idle = along <= 0  # points that carry nothing: any stiffness does
        along[idle], across[idle] = along.max(initial=0.0) or usual, across.max(initial=0.0) or usual
        root = Points(normal, 1 / np.sqrt(along), 1 / np.sqrt(across), np.ones(count))
        factor = 1.0 if idle.all() else max(1.0, _largest(own, root))
        points.stiff_n[at], points.stiff_t[at] = 1 / (along * factor), 1 / (across * factor)


def _largest(S: sp.csr_array, root: Points) -> float:
    """The largest eigenvalue of keq^½ S keq^½; ``root`` applies keq^½."""
    shape = (3, len(root))

    def apply(x: np.ndarray) -> np.ndarray:
        return root.stiffness(np.reshape(S @ root.stiffness(np.reshape(x, shape)).ravel(), shape)).ravel()

    if len(root) < 3:
        return float(np.linalg.eigvalsh(np.column_stack([apply(e) for e in np.eye(S.shape[0])]))[-1])
    start = np.random.default_rng(0).standard_normal(S.shape[0])
    operator = sla.LinearOperator(S.shape, matvec=apply, dtype=float)
    return float(sla.eigsh(operator, k=1, which="LA", tol=KNOWN, v0=start, return_eigenvectors=False)[0])


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
