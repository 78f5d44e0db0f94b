"""The points of a rank's interfaces: at which nodes a law acts, along which normal, on which area;
search direction, law's
parameters, ε of stabilisation.

The diagonal search direction k⁺ has, at every pair of nodes, one stiffness along the normal and one
across it. Both sides get the mean of their own k⁻, so that keq = k⁺/2. Where nodes do not match, k⁺
is each node's own 3 × 3 block of k⁻.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import scipy.sparse as sp

from orchestrator.laws.points import Points
from orchestrator.method.interface.pairs import Pairs, Run
from orchestrator.method.interface.point_traces import (
    NodeCompliance, inverses, node_blocks, search_stiffness)
from orchestrator.method.interface.rows import bounds_of
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.method.interface.transfer import Transfer
from orchestrator.scene.mesh.geometry import (
    area_vectors, mirrored, node_areas, node_vectors, unit, within)
from orchestrator.scene.mesh.quadratic import LUMPED_SHARES
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.facets import stiffer
from orchestrator.scene.soles.ring import INCOMPRESSIBLE


def make_pairs(scene: Scene, space: TraceSpace, k: sp.csr_array,
               stabilisation: np.ndarray | None = None) -> Pairs:
    """Points of the interfaces that a rank touches, ordered by law.

    k : (D + G, D + G) search direction k⁻, ghosts included
    stabilisation : (interfaces,) ε of every interface of the scene; default: none
    """
    here = set(space.subdomains)
    wanted = sorted((i for i in scene.interfaces if here.intersection(i.subdomains)),
                    key=lambda i: (i.law.perfect, i.law.name, i.index))
    # a rank may have no such interface
    rows, normal, area, own = [np.empty((0, 3), int)], [np.empty((0, 3))], [np.empty(0)], []
    for i in wanted:
        where, chosen = scene.points(i), lawful_nodes(i)
        at = geometry_of(where, i, i.shares)
        share = at.area[chosen]
        own.append([law.parameters(chosen, at.length[chosen], share)
                    for law in (i.law, *i.law_at_steps)])
        rows.append(_numbers(space.transfer, i, chosen))
        normal.append(at.acting[chosen])
        # pressures of what carries nothing are zero
        area.append(np.where(share > 0, share, share.max(initial=0.0) or 1.0))
    bounds = bounds_of([len(a) for a in area[1:]])
    transfer = space.transfer.at(np.ascontiguousarray(np.concatenate(rows).T), bounds)
    points = Points(np.ascontiguousarray(np.concatenate(normal).T), *np.ones((2, bounds[-1])),
                    np.concatenate(area))
    nodes = _search_direction(space, k, wanted, transfer, points)
    if stabilisation is not None:  # on all ranks, or on none
        stabilisation = _beside_laws(stabilisation, scene, wanted, bounds,
                                     points) if stabilisation.any() else None
    mine = np.repeat([i.subdomains[0] in here for i in wanted], np.diff(bounds)).astype(bool)
    laws = sorted({type(i.law) for i in scene.interfaces}, key=lambda law: law.name)
    return Pairs(wanted, transfer, nodes, _runs(wanted, bounds, points, own), mine, laws,
                 stabilisation, np.arange(scene.steps), np.zeros((3, bounds[-1])),
                 beside=_beside(scene, space, wanted, transfer))


def _beside(scene: Scene, space: TraceSpace, interfaces: list[Interface],
            transfer: Transfer) -> np.ndarray:
    """(b,) int, ascending, points of bonds at nodes where other laws have points, too, or bonds
    lead to such nodes; nodes match. All ranks ask together.

    Nearly incompressible soles couple neighbouring nodes by their bulk modulus: node by node their
    bonds would answer worse than side by side (64 cubes, ν = .499, in contact half way: 126
    iterations, and 59).
    """
    def apart(i: Interface) -> bool:
        poisson = scene.moduli[scene.cell_material[i.cells], 1]
        return i.law.perfect and poisson.max(initial=0.0) >= INCOMPRESSIBLE

    bonded, matching = (np.repeat(np.array(values, bool), np.diff(transfer.bounds)) for values in (
        [i.law.perfect for i in interfaces], [i.matching and not apart(i) for i in interfaces]))
    ends, node = np.stack([transfer.one, transfer.two]).max(axis=1, initial=-1), space.dof // 3
    meets = np.zeros(int(node.max(initial=-1)) + 1, bool)

    def spread(chosen: np.ndarray) -> bool:
        own = ends[:, chosen]
        at, before = node[own[(own >= 0) & (own < space.size)]], meets.sum()
        meets[at] = True
        return space.team.max(float(meets.sum() > before))[0] > 0

    bonds, more = np.flatnonzero(bonded & matching & (ends[0] >= 0)), spread(matching & ~bonded)
    found = bonds[:0]
    while more:
        on = space.extended(meets[node][None].astype(float))[0][0] > 0
        found = bonds[on[ends[:, bonds]].any(axis=0)]
        more = spread(found)
    return found


def _numbers(transfer: Transfer, interface: Interface, chosen: np.ndarray) -> np.ndarray:
    """(p, 3) int, which flat points of the scene the components of an interface's points are, −1
    for none.
    """
    mortar = interface.mortar
    live = interface.free if mortar is None else mortar.live
    number = transfer.bounds[interface.index] + np.cumsum(live).reshape(live.shape) - 1
    number = np.where(live, number, -1)
    return number[chosen] if mortar is None else np.where(mortar.carrying[:, None], number, -1)


def _search_direction(space: TraceSpace, k: sp.csr_array, interfaces: list[Interface],
                      transfer: Transfer,
                      points: Points) -> NodeCompliance:
    """Sets the stiffness keq of points; returns C = (k⁺)⁻¹ of their nodes."""
    # all ranks ask
    bounds, held = transfer.bounds, None if transfer.picks else space.held_everywhere
    at_mortars = np.repeat([i.mortar is not None for i in interfaces], np.diff(bounds)).astype(bool)
    pair = np.flatnonzero(~at_mortars)
    one, two = (np.ascontiguousarray(side[:, pair].T) for side in (transfer.one, transfer.two))
    normal, there = points.normal[:, pair].T, one >= 0
    blocks = 0.5 * (node_blocks(k, one) + node_blocks(k, two))
    # a missing component takes the mean of the others
    trace = np.trace(blocks, axis1=1, axis2=2) * 3 / np.maximum(there.sum(axis=1), 1)
    along = np.einsum("pi,pij,pj->p", normal, blocks, normal)
    along = np.where(there.all(axis=1), along, np.maximum(along, trace / 3))
    points.stiff_n[pair], points.stiff_t[pair] = along / 2, (trace - along) / 4
    half = points.some(pair).compliance(np.repeat(np.eye(3)[:, :, None], len(pair),
                                                  axis=2)).transpose(2, 0, 1) / 2
    nodes = [(one, half), (two, half)]
    for i in interfaces:
        if i.mortar is not None:
            for side, own in enumerate(space.sides[i.index]):
                at = own.reshape(-1, 3)
                nodes.append((at, inverses(node_blocks(k, at), ~held[at])))
    result = NodeCompliance.of(nodes, transfer)
    if at_mortars.any():
        gives = result.compliance.diagonal()
        usual = 2 * float(gives.sum() / max(np.count_nonzero(gives), 1)) or 1.0
        parts = [np.arange(a, b) for i, a, b in zip(interfaces, bounds[:-1], bounds[1:])
                 if i.mortar is not None]
        S = transfer.B @ result.compliance @ transfer.B.T
        search_stiffness(S, points, parts, usual)
    return result


def _beside_laws(stabilisation: np.ndarray, scene: Scene, wanted: list[Interface],
                 bounds: np.ndarray,
                 points: Points) -> np.ndarray:
    """(P,) ε of every pair: its spring ε keq is to be weak beside the law's own, which may be
    softer than keq, and no
    stiffer where soles are made ``stiffer`` at single nodes."""
    each, rigidity = (np.repeat(x, np.diff(bounds)) for x in (
        stabilisation[[i.index for i in wanted]], np.array([i.law.rigidity for i in wanted])))
    for i, start, end in zip(wanted, bounds[:-1], bounds[1:]):
        if i.matching and not i.law.perfect:
            each[start:end] /= stiffer(scene, i, 0)[lawful_nodes(i)]
    return each * np.minimum(1.0, rigidity * points.area / points.stiff_n)


def _runs(interfaces: list[Interface], bounds: np.ndarray, points: Points,
          own: list[list[dict]]) -> list[Run]:
    """The interfaces' points joined, law after law.

    own : interface by interface the parameters of its law, then those of each load step, if they
        differ
    """
    runs, each = [], zip(interfaces, bounds[:-1], bounds[1:], own)
    for law, group in groupby(each, key=lambda one: type(one[0].law)):
        some, starts, ends, given = zip(*group)
        part = slice(int(starts[0]), int(ends[-1]))
        constant, *steps = (_side_by_side([one[t] if t < len(one) else one[0] for one in given])
                            for t in range(max(map(len, given))))
        stepped = {name: np.stack([values[name] for values in steps]) for name in constant if steps}
        stepped = {name: x for name, x in stepped.items() if (x != x[:1]).any()}
        numbers = np.repeat([i.index for i in some], np.subtract(ends, starts))
        runs.append(Run(law, part, replace(points.some(part), own=constant, stepped=stepped,
                                           interface=numbers)))
    return runs


def _side_by_side(given: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Parameters of interfaces one after the other."""
    return {name: np.concatenate([values[name] for values in given], axis=-1) for name in given[0]}


def lawful_nodes(interface: Interface) -> np.ndarray:
    """(p,) int, ascending, which of an interface's nodes a law answers for: none that is prescribed
    altogether, and where points
    are no pairs of nodes those that carry points."""
    return interface.mortar.points if interface.mortar is not None else np.flatnonzero(
        interface.free.any(axis=1))


@dataclass(frozen=True)
class Geometry:
    """Normals and areas at the nodes of an interface.

    normal : (n, 3) unit, from side 1 to side 2
    acting : (n, 3) the same within the components that the law acts in; length : (n,) left of each
    area : (n,) that each stands for, seen along its normal where laws press, as it is where they
        are springs or weights; 0 at nodes that carry no point
    """

    normal: np.ndarray
    acting: np.ndarray
    length: np.ndarray
    area: np.ndarray


def geometry_of(points: np.ndarray, interface: Interface, shares: np.ndarray) -> Geometry:
    """Return normals and areas at the nodes of an interface at points (n, 3).

    Area times normal is ∫ Nᵢ n dA over the facets around a node, so that constant pressure is in
    equilibrium however they are bent. Where there are no facets areas are infinite: what such nodes
    carry, which are bonded, is no pressure.

    shares : (3 or 6,) ∫ Nᵢ over a facet, see ``Interface.shares``
    """
    vectors = node_vectors(points, interface.triangles, shares)
    normal, free, mortar = unit(vectors), interface.free, interface.mortar
    if mortar is None:
        normal = normal if interface.normals is None else interface.normals
        facets = area_vectors(points, interface.triangles)
        normal = mirrored(normal, facets, interface.triangles, ~free)
        area = np.einsum("ni,ni->n", vectors, normal)
        if not len(interface.triangles):
            area = np.full(len(points), np.inf)
        # as much of a face as there is, however it is bent
        elif interface.law.as_one or interface.law.rigidity < np.inf:
            area = node_areas(points, interface.triangles, shares)
    else:
        area, free = np.zeros(len(points)), np.ones_like(free)
        normal = unit(node_vectors(points, interface.triangles, LUMPED_SHARES[len(shares)]))
        at = mortar.points
        normal[at], area[at], free[at] = mortar.normal, mortar.area, mortar.live
    return Geometry(normal, *within(normal, free), area)
