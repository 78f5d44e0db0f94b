"""Soles made of the neighbours' own elements, for matter or meshes that a layer of prisms imitates
badly; where these are.

The first row of elements of both sides is copied and clamped behind: most of the modulus is the
other side's, which the sole stands for, ``OWN`` of it one's own. What the sole feels at a node is
then a share of what the elements there feel, whatever their matter, their shape and their order
along the interface: with stiff and soft cells side by side (contrast 1:1000) a sole that follows
the facets alone misses the stiff cells that touch the interface by an edge. There cells of other
subdomains count as well that bonds join to both sides at a node: without them iterations of 64
cubes of such bricks, in contact half way, are 64, with them 32. The Schur complement of
a subdomain never exceeds its own first row clamped behind, so that with modulus ratio r and at most
n interfaces meeting in an element S ≤ n / (OWN r) k, whatever the contrast: there is nothing that
the sole is too soft for.

With ten-node tets an element may join two nodes of the interface by an edge that is on none of its
faces, whose middle is not a trace. There are two copies then, of half the modulus: in each, one end
of the edge is a node of its own, clamped.

A copy of nearly incompressible matter, clamped behind, resists by its bulk modulus what the
subdomain itself, free to flow, resists by its shear modulus alone. Of two such extremes the best
search direction is the geometric mean, as for Robin conditions between any two ends of a spectrum:
λ' = √(λ μ) in the copy. Soft modes are fewer then, and what they cost. Four-node tets cannot flow
without changing their volumes: their copies keep their bulk modulus.

Affine macro functions and soles that follow the facets serve compact subdomains of one matter. They
fail where a subdomain has soft ways to move that are not affine on its interfaces: where stiff and
soft cells are mixed, where the matter is nearly incompressible, where the subdomain is slender or
flat (``difficulty``).

What a ring clamps behind may hang loosely there. An *island* is a piece of one matter in several
subdomains that no stiffer matter touches, and that no other matter holds: it moves at the cost of
soft matter alone, and no ring of its own stiff elements is as soft. The macro problem moves islands
(``method.linear.coarse_nodes``). Iterations of 27 cubes, moduli 1:1000, with a free island of two
bricks: 51, and 21 where it is moved; 1,000 cubes with two that hang by an edge: 29 and 22.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import scipy.sparse as sp

from orchestrator.linalg import WRITTEN
from orchestrator.scene.mesh.faces import faces_of, pieces
from orchestrator.scene.interfaces.mortar.surfaces import CONTRAST
from orchestrator.scene.mesh.quadratic import TET_EDGES, with_middles
from orchestrator.scene.interface import Difficulty, Interface
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.soles import Sole
from orchestrator.scene.soles.ring import between, INCOMPRESSIBLE

# Of the modulus, the share of one's own elements. Iterations with .5, .2 and 0 of it: moduli 1:1000
# brick by brick, 64 subdomains: 40, 32,
# 33; 125 of them: 100, 81, 92; ν = .499, ten-node tets: 64, 64, 71; four-node tets, 8 cubes: 18,
# 19, 41.
OWN = 0.2
# (16, 4) bool, all sets of a tet's corners
SETS = (np.arange(16)[:, None] >> np.arange(4)) % 2 == 1


def overlap(scene: Scene, interface: Interface, ratio: float,
            others: Iterable[tuple[int, np.ndarray, np.ndarray]] = ()) -> tuple[Sole, Sole]:
    """The soles of both sides of an interface whose sides share their nodes: they differ in their
    moduli alone.

    ratio : ``method.sole.modulus_ratio``, dealt out to the copies of either side's elements
    others : further subdomains bonded to them at some nodes: each one's number, its local nodes
        (m,), and which of the interface's they are (m,), see ``BondedNodes.others``
    """
    inner = scene.side_points(interface, 0)
    found = []
    met = [(e, nodes, np.arange(len(inner)))
           for e, nodes in zip(interface.subdomains, interface.nodes)]
    for side, (e, nodes, at) in enumerate([*met, *others]):
        subdomain = scene.subdomains[e]
        row = first_row(subdomain, nodes)
        number, cells = np.full(len(subdomain.nodes), -1), subdomain.connectivity[row]
        number[nodes] = at
        found.append((number[cells], subdomain.nodes[cells[:, :4]], np.full(len(row), side),
                      scene.moduli[subdomain.material[row]]))
    whole, nodes, sides, moduli = map(np.concatenate, zip(*found))
    (young, poisson), cells = moduli.T, whole[:, :4].copy()
    outer, place = np.unique(nodes[cells < 0], return_inverse=True)
    cells[cells < 0] = len(inner) + place.ravel()
    points = scene.mesh.nodes[outer]
    if whole.shape[1] == 10:
        own = np.concatenate([whole[:, [*ends, 4 + i]] for i, ends in enumerate(TET_EDGES)])
        own = own[(own >= 0).all(axis=1)]
        points, cells, origin = _without_chords(inner, own, points, cells, sides)
        points, cells = with_middles(inner, own, points, cells)
        sides, poisson = sides[origin], poisson[origin]
        young = (young / np.bincount(origin))[origin]
        poisson = np.where(poisson > INCOMPRESSIBLE, between(poisson), poisson)
    return tuple(Sole(points, cells, ratio * np.where(sides == side, OWN, 1 - OWN) * young, poisson)
                 for side in (0, 1))


def _without_chords(inner: np.ndarray, lines: np.ndarray, points: np.ndarray, cells: np.ndarray,
                    sides: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points and cells (c, 4) whose edges between nodes of the interface all have their
    middles
    among its nodes, and (c,) of which cell each is a copy.

    An element has a copy for each largest set of its corners without a chord; the other corners are
    other nodes, the same in all elements of a side. So each facet is a face of some copy.

    inner : (n, 3) nodes of the interface; the others are ``points``
    lines : (e, 3) int, edges on its facets: ends and middles
    points : (p, 3); cells : (q, 4); sides : (q,) int, 0 or 1, whose element each cell is
    """
    n, total = len(inner), len(inner) + len(points)
    pairs = np.sort(cells[:, TET_EDGES], axis=2)
    known = np.sort(lines[:, :2], axis=1) @ [n, 1]
    chord = (pairs[..., 1] < n) & ~np.isin(pairs @ [n, 1], known)
    free = ~(chord[:, None] & SETS[:, TET_EDGES].all(axis=2)).any(axis=2)
    larger = np.arange(16)[:, None] | 1 << np.arange(4)
    origin, kept = np.nonzero(free & ~(free[:, larger] & ~SETS).any(axis=2))
    cells = cells[origin]
    cells = np.where(SETS[kept], cells, total + n * sides[origin, None] + cells)
    copies, number = np.unique(cells[cells >= total], return_inverse=True)
    cells[cells >= total] = total + number
    return np.vstack([points, inner[(copies - total) % n]]), cells, origin


def first_row(subdomain: Subdomain, nodes: np.ndarray) -> np.ndarray:
    """(r,) int, which of the cells of a subdomain touch some of its nodes (n,)."""
    on = np.zeros(len(subdomain.nodes), bool)
    on[nodes] = True
    return np.flatnonzero(on[subdomain.connectivity].any(axis=1))


SLENDER = 10.0  # largest over smallest extent
# Copies of nearly incompressible ten-node tets resist by √(λ μ), so that √(μ/λ) of it is what the
# softest of the subdomain's own
# ways to move resist. With ν = .499, .045 of it, soft modes save 12 of 64 stages for 416
# back-substitutions per subdomain at
# set-up; with ν = .4999, .014, they save 46 of 110 for 220. The limit lies between.
YIELDING = 0.03


def difficulty(scene: Scene) -> Difficulty:
    """Judge every interface and every subdomain."""
    if scene.overview is not None:
        return scene.overview.difficulty
    young, poisson = scene.moduli.T
    mixed = np.zeros(len(scene.interfaces), bool)
    if young.max() > CONTRAST * young.min():
        for i in scene.interfaces:
            sides = ((scene.subdomains[e], nodes) for e, nodes in zip(i.subdomains, i.nodes))
            rows = [young[s.material[first_row(s, nodes)]] for s, nodes in sides]
            mixed[i.index] = any(row.max() > CONTRAST * row.min() for row in rows)
    largest = np.array([poisson[s.material].max() for s in scene.subdomains])
    incompressible = largest > INCOMPRESSIBLE
    # four-node tets cannot flow without changing their volumes, and their copies resist by all of
    # their bulk modulus
    yielding = largest > 0.5 / (1 + YIELDING**2)
    flowing = yielding if scene.mesh.cells.shape[1] == 10 else incompressible
    extents = slenderness([s.nodes for s in scene.subdomains], scene.mesh.nodes)
    slender = extents >= SLENDER * (1 - WRITTEN)
    ours = ~scene.stand_ins  # thin layers that stand for something else bend nowhere
    bad = ((each | slender) & ours for each in (incompressible, flowing, yielding))
    return Difficulty(mixed, *bad, extents)


def islands(scene: Scene) -> np.ndarray:
    """Return (n,) int, the island of each node of a scene, −1: of none.

    Only those that lie in no more subdomains than meet at one of their nodes: rigid motions do for
    no others. Other matter *holds* a piece in more than three nodes.
    """
    if scene.overview is not None:
        return scene.overview.islands[scene.number]
    young, cells = scene.moduli[scene.cell_material, 0], scene.mesh.cells
    of_node, corners = np.full(len(scene.mesh.nodes), -1), cells[:, :4]
    if young.max() <= CONTRAST * young.min():
        return of_node
    count, piece = pieces(faces_of(corners, len(of_node)), scene.cell_material)
    most, meet = np.zeros(len(of_node)), np.zeros(count)
    np.maximum.at(most, corners, young[:, None])
    np.maximum.at(meet, piece, np.diff(scene.shared.indptr)[corners].max(axis=1))
    stiff = CONTRAST * young[:, None] > most[corners]
    cell, corner = np.nonzero(stiff)
    touch = sp.csr_array((np.ones(len(cell)), (corners[cell, corner], piece[cell])),
                         shape=(len(of_node), count))
    held = (touch[np.diff(touch.indptr) > 1] > 0).sum(axis=0)
    parts = sp.csr_array((np.ones(len(cells)), (piece, scene.cell_subdomain)))
    many = np.diff(parts.indptr)
    there = (1 < many) & (many <= meet) & (held <= 3)
    there[piece[~stiff.all(axis=1)]] = False
    inside = there[piece]
    of_node[cells[inside]] = piece[inside, None]
    return of_node


def by_nodes(scene: Scene, method) -> bool:
    """Return whether a scene is solved with rings, one state per node of a subdomain: where all of
    it
    is one bonded mesh, and no part is slender, or yields at constant volume: these need soft modes.

    method : ``method`` of the configuration: what it asks of layers or interfaces excludes rings
    """
    sole, macro = method.sole, method.macro
    usual = (
        sole.thickness == sole.poisson == macro.basis == "auto" and macro.strategy != "continuity")
    if not (usual and method.search_direction.kplus == "exchange" and scene.conforming):
        return False
    return sole.kind == "overlap" or sole.kind == "auto" and not difficulty(scene).softest.any()


def slenderness(clouds: Sequence[np.ndarray], nodes: np.ndarray) -> np.ndarray:
    """(clouds,) largest over smallest extent of sets of nodes along their principal axes.

    clouds : each (n,) int, n > 0, which of the nodes
    nodes : (all, 3) coordinates
    """
    counts = np.array([len(cloud) for cloud in clouds])
    starts, member = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
    points = nodes[np.concatenate(clouds)]
    centred = points - (np.add.reduceat(points, starts) / counts[:, None])[member]
    axes = np.linalg.eigh(np.add.reduceat(centred[:, :, None] * centred[:, None], starts))[1]
    along = np.einsum("ni,nij->nj", centred, axes[member])
    extents = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
    return extents.max(axis=1) / np.maximum(extents.min(axis=1), np.finfo(float).tiny)
