"""How far and how much subdomains have moved and turned, beside the size of their bodies: whether
perturbations are small.

Parts that end inside each other, where no interface keeps them apart: of pairs that are near before
loading, at every load step.

Sides slide whose pairs stay as they are; what that makes amiss are two numbers for each interface.
A point meets what was opposite it before loading, along its own normal n. Having slid by s it
should meet a place where the other side's normal is m and turns by ∇m s on the way: the distance is
off by

    s·(m − n) + s·∇(m − n)·s / 2

which is nothing where surfaces conform, as a shaft and its bore, or are plane. A distance e that is
amiss within an element of size h is a pressure of E e/h, so that pressures are off by the share
that e has of p h/E, or of a press fit that is more than that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orchestrator.laws.points import table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.method.interface.rows import peak
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.mortar.operators import scalar
from orchestrator.scene.interfaces.opposite import COINCIDE, Triangles
from orchestrator.scene.interfaces.overlap import DEEP, Overlap, overlap, Solid, solid_of
from orchestrator.scene.interfaces.skins import SMOOTH, surface_of
from orchestrator.scene.mesh.geometry import node_vectors, unit
from orchestrator.scene.mesh.quadratic import LUMPED_SHARES
from orchestrator.scene.model import Scene

@dataclass(frozen=True)
class Moved:
    """Of all subdomains of a scene, the largest in any load step; (subdomains,) each."""

    displacement: np.ndarray  # of a component at a node
    rotation: np.ndarray  # radians
    # of the body that each is a piece of: twice the largest distance of a node from the middle of
    # all
    size: np.ndarray

    @classmethod
    def of(cls, scene: Scene, sides: Sequence[np.ndarray]) -> Moved:
        """Return how far displacements (T, n_E, 3) of each subdomain move them."""
        points = [scene.mesh.nodes[s.nodes] for s in scene.subdomains]
        body = np.unique([s.body for s in scene.subdomains], return_inverse=True)[1].ravel()
        sums = np.array([[*x.sum(axis=0), len(x)] for x in points])
        sums = np.stack([np.bincount(body, weights=column) for column in sums.T], axis=1)
        centre, far = sums[:, :3] / np.maximum(sums[:, 3:], 1), np.zeros(len(sums))
        for b, x in zip(body, points):
            far[b] = max(far[b], peak(np.linalg.norm(x - centre[b], axis=1)))
        return cls(np.array([peak(u) for u in sides]), rotations(points, sides),
                   2 * np.where(far > 0, far, 1.0)[body])


def rotations(points: Sequence[np.ndarray], displacements: Sequence[np.ndarray]) -> np.ndarray:
    """(bodies,) largest rotation, in radians, of the rigid motions that fit displacements (steps,
    n, 3) of points (n, 3) best.
    """
    counts = np.array([len(p) for p in points])
    starts, member = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
    x, u = np.concatenate(points), np.concatenate(displacements, axis=1)
    arm = x - (np.add.reduceat(x, starts) / counts[:, None])[member]
    products = np.add.reduceat(arm[:, :, None] * arm[:, None], starts)
    inertia = np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(3) - products
    moved = u - (np.add.reduceat(u, starts, axis=1) / counts[:, None])[:, member]
    moment = np.add.reduceat(np.cross(arm, moved), starts, axis=1)
    turned = np.einsum("tei,eij->tej", moment, np.linalg.pinv(inertia))
    return np.linalg.norm(turned, axis=2).max(axis=0, initial=0.0)


class Passed(NamedTuple):
    """Two volumes that are inside each other, names of their bodies, and the load step at which
    they are deepest.
    """

    pair: tuple[int, int]
    bodies: frozenset[str]
    step: int
    found: Overlap


class _Part(NamedTuple):
    """A volume of the mesh as it is displaced.

    solid : before that
    sagitta : (k,) how far surfaces are off the k outer faces; displacement : (T, n, 3)
    """

    solid: Solid
    sagitta: np.ndarray
    displacement: np.ndarray

    @classmethod
    def of(cls, scene: Scene, sides: Sequence[np.ndarray], volume: int) -> _Part:
        number, solid = solid_of(scene.mesh, volume)
        displacement = np.zeros((scene.steps, len(number), 3))
        for s in (scene.subdomains[e]
                  for e in np.unique(scene.cell_subdomain[scene.mesh.volume == volume])):
            _, own, at = np.intersect1d(s.nodes, number, assume_unique=True, return_indices=True)
            displacement[:, at] = sides[s.index][:, own]
        return cls(solid, scene.sagitta[volume], displacement)

    def at(self, step: int | None) -> Solid:
        """The volume at a load step, or at rest."""
        return self.solid if step is None else self.solid.moved(self.displacement[step])


def passing(scene: Scene, sides: Sequence[np.ndarray]) -> list[Passed]:
    """Return all pairs of a scene.

    sides : per subdomain (T, n_E, 3) displacement
    """
    if not scene.near:
        return []
    parts = {v: _Part.of(scene, sides, v) for v in scene.sagitta}
    bodies = {
        v: {scene.subdomains[e].body
            for e in np.unique(scene.cell_subdomain[scene.mesh.volume == v])} for v in parts}
    cells = [np.unique(scene.mesh.volume[i.cells], axis=0).tolist() for i in scene.interfaces]
    joined = {tuple(sorted(pair)) for pairs in cells for pair in pairs}
    own = {pair: DEEP if tuple(sorted(pair)) in joined else COINCIDE for pair in scene.near}
    return [Passed(pair, frozenset(bodies[pair[0]] | bodies[pair[1]]), step, deepest)
            for pair, step, deepest in _deepest(parts, own, scene.steps)]


def _deepest(parts: dict[int, _Part], pairs: dict[tuple[int, int], float],
             steps: int) -> list[tuple[tuple[int, int], int, Overlap]]:
    """Pairs that are inside each other, when and how deep.

    pairs : from which share of the mesh size on each counts: beside an interface of theirs nodes of
        one dip in between those of the other, as discretised contact has it
    """

    def overlaps(step: int | None,
                 chosen: Iterable[tuple[int, int]]) -> dict[tuple[int, int], Overlap]:
        """The chosen pairs that are inside each other, and how deep; every part is made once."""
        solids = {v: parts[v].at(step) for v in {v for pair in chosen for v in pair}}
        # chords of curved faces may be inside each other, from the start and as they turn: that is
        # no motion
        found = {(a, b): overlap(solids[a], solids[b], (parts[a].sagitta, parts[b].sagitta),
                                 pairs[a, b]) for a, b in chosen}
        return {pair: o for pair, o in found.items() if o is not None}

    # what has moved by less than counts has not moved that deep into anything
    far = {v: peak(np.linalg.norm(part.displacement, axis=2)) for v, part in parts.items()}
    least = {v: part.solid.surface.size.min(initial=np.inf) for v, part in parts.items()}
    pairs = {(a, b): deep for (a, b), deep in pairs.items()
             if far[a] + far[b] > deep * min(least[a], least[b])}
    each = [overlaps(step, pairs) for step in range(steps)]
    rest, result = overlaps(None, sorted({pair for found in each for pair in found})), []
    for pair, deep in pairs.items():
        found = [(o.depth, -step, o) for step, here in enumerate(each)
                 if (o := here.get(pair)) is not None]
        found = [f for f in found if pair not in rest or f[0] - rest[pair].depth > deep * f[2].size]
        if found:
            _, step, o = max(found, key=lambda f: f[:2])
            result.append((pair, -step, o))
    return result


def slides(scene: Scene, fields: InterfaceFields) -> tuple[np.ndarray, np.ndarray]:
    """(I,) how far sides have slid, in elements, and (I,) what that makes amiss; nan where pairs
    follow.
    """
    interfaces = scene.opening
    holds = np.isin(fields.status, [s for s in table(i.law for i in scene.interfaces) if s.holds])
    slip, (far, amiss) = np.where(holds[..., None], fields.slip,
                                  0.0), np.full((2, len(interfaces)), np.nan)
    for i, (k, own) in zip(interfaces, fields.each()):
        if i.follows or i.ground or i.tool is not None:
            continue
        facets = fields.triangles[fields.owner == k]
        corners = fields.points[0, facets]
        size = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
        far[k] = peak(np.linalg.norm(slip[:, own], axis=2)) / size
        amiss[k] = _amiss(scene, i, fields, slip, own, facets) if far[k] > 0 else 0.0
    return far, amiss


def _amiss(scene: Scene, i: Interface, fields: InterfaceFields, slip: np.ndarray, own: slice,
           facets: np.ndarray) -> float:
    """The largest distance that is amiss, over the largest that presses.

    slip : (T, N, 3), zero where nothing holds; own : the interface's of the N nodes; facets : (m,
        3) int, indices into the N
    """
    normals = np.zeros((len(fields.nodes), 3))
    normals[own] = _turn(scene, i)
    if not normals.any():
        return 0.0
    shape = Triangles.of(fields.points[0, facets])
    cosine = np.einsum("mvi,mvi->mv", fields.normal[facets],
                       np.roll(fields.normal[facets], 1, axis=1)).min(axis=1)
    # normals of the other side are means over as much as a facet: what they differ by from surfaces
    # that conform
    apart = (np.linalg.norm(normals[facets], axis=2) > 1 - cosine[:, None]).any(axis=1)
    mean = slip[:, facets].mean(axis=2)
    turned = np.einsum("mvi,mvj,tmj->tmi", normals[facets], shape.slopes, mean)
    off = np.einsum("tmi,tmi->tm", mean, normals[facets].mean(axis=1) + turned / 2)
    young = min(scene.materials[m].young for m in np.unique(scene.cell_material[i.cells]))
    presses = fields.pressure[:, facets].mean(axis=2) * shape.size / young
    scale = max(float(presses.max(initial=0.0)), float(-fields.initial_gap[own].min(initial=0.0)))
    held = (cosine > SMOOTH) & apart & (presses > 0)
    return peak(np.where(held, off, 0.0)) / scale if scale > 0 else 0.0


def _turn(scene: Scene, i: Interface) -> np.ndarray:
    """(c, 3) by how much the other side's unit normals differ from an interface's own, at the nodes
    shown; 0 where nothing is opposite.
    """
    points, other = (scene.side_points(i, side) for side in (0, 1))
    if i.paired and np.array_equal(points, other):  # as where one mesh was cut: the same facets
        return np.zeros_like(points)[i.shown]
    one, two = _normals(points, i.triangles), _normals(other, i.triangles_on(1))
    if i.paired:
        return (two - one)[i.shown]
    there = unit(scalar(i.mortar.second) @ two)
    result = np.zeros_like(one)
    result[i.mortar.points] = np.where(there.any(axis=1)[:, None], there - one[i.mortar.points],
                                       0.0)
    return result[i.shown]


def _normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals of the surface that facets on points (n, 3) stand for."""
    known = surface_of(points, triangles, -1).normals
    return unit(node_vectors(points, triangles, LUMPED_SHARES[triangles.shape[1]], known))
