"""Pairs of faces that lie on each other: those of a scene, and those that a mesh alone shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.interfaces.facing import Facing, facing
from orchestrator.scene.interfaces.pairing import Body, close_bodies, match, outer_bodies
from orchestrator.scene.interfaces.patches import patches
from orchestrator.scene.interfaces.skins import Skins
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import area_vectors, node_normals
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface, Scene

SHARED, COINCIDENT, APART = "shared", "matching", "not matching"


@dataclass(frozen=True)
class PairRow:
    """One patch on which two parts lie on each other.

    one, two : names of the parts
    area : that they have in common
    nearest, farthest : distance of the sides along the normal; negative inside each other
    meshes : whether faces are shared, nodes coincide or project onto each other, or neither
    slave : name of the part whose nodes carry the points; empty where nodes are paired
    size : element size of either side
    law : that governs; empty where that is not known
    """

    one: str
    two: str
    area: float
    nearest: float
    farthest: float
    meshes: str
    slave: str
    size: tuple[float, float]
    law: str = ""


def pairs_of_scene(scene: Scene) -> Iterator[PairRow]:
    """The interfaces between different bodies, in their order."""
    for interface in scene.interfaces:
        one, two = (scene.subdomains[e] for e in interface.subdomains)
        if one.body == two.body or not len(interface.triangles):
            continue
        sizes, areas = zip(*(_measures(scene, interface, side) for side in (0, 1)))
        if interface.mortar is not None:
            points, area, slave = interface.mortar.points, float(interface.mortar.area.sum()), one.name
            read = interface.law.distance
            distance, meshes = read[points] if np.ndim(read) else interface.mortar.gap, APART
        else:
            x, y = (scene.side_points(interface, side) for side in (0, 1))
            normal = node_normals(scene.points(interface), interface.triangles)
            distance, area, slave = np.einsum("ni,ni->n", y - x, normal), areas[0], ""
            meshes = SHARED if np.array_equal(*(scene.side_nodes(interface, side) for side in (0, 1))) else COINCIDENT
        yield PairRow(one.name, two.name, area, float(distance.min()), float(distance.max()), meshes, slave, sizes, interface.law.name)


def _measures(scene: Scene, interface: Interface, side: int) -> tuple[float, float]:
    """Mean element size and area of an interface's facets on one side."""
    each = np.linalg.norm(area_vectors(scene.side_points(interface, side), interface.triangles_on(side)), axis=1)
    return float(np.sqrt(2 * each).mean()), float(each.sum())


def pairs_of_mesh(mesh: Mesh, faces: Faces) -> Iterator[PairRow]:
    """What touches, whatever laws may say: shared faces, then faces that lie on each other."""
    shared, sides, bounds = patches(faces, mesh.volume)
    for first, last in zip(bounds[:-1], bounds[1:]):
        each = np.linalg.norm(area_vectors(mesh.nodes, faces.triangles[shared[first:last]]), axis=1)
        size = float(np.sqrt(2 * each).mean())
        yield PairRow(*(mesh.volumes[v] for v in sides[first]), float(each.sum()), 0.0, 0.0, SHARED, "", (size, size))
    if len(mesh.volumes) < 2:
        return
    skins = Skins(mesh, faces)
    for one, two in close_bodies(outer_bodies(mesh, faces, mesh.volume), None):
        matching = {tuple(row) for patch in match(one, two, False)[0] for row in patch.triangles.tolist()}
        for found in facing(skins(one), skins(two)):
            yield _row(mesh, one, two, found, matching)


def _row(mesh: Mesh, one: Body, two: Body, found: Facing, matching: set[tuple[int, ...]]) -> PairRow:
    fits = all(tuple(row) in matching for row in one.triangles[found.facets[0]].tolist())
    return PairRow(mesh.volumes[one.volume], mesh.volumes[two.volume], found.area, found.lowest, found.highest,
                   COINCIDENT if fits else APART, "", found.size)
