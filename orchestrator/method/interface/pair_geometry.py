"""Where a law acts on an interface: at which nodes, along which normal, on which area."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors, node_areas, node_normals
from orchestrator.scene.model import Interface

# Prescribed components are taken out of a normal that keeps this much of its length.
UPRIGHT = 1e-6


def lawful_nodes(interface: Interface) -> np.ndarray:
    """(p,) int, ascending, which of an interface's nodes a law answers for: not those that are prescribed altogether, not
    mid-edge nodes that are tied, and where nodes do not match those that carry points."""
    if interface.mortar is not None:
        return interface.mortar.points
    mobile = interface.free.any(axis=1)
    if interface.tied:
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


def pair_areas(points: np.ndarray, interface: Interface) -> np.ndarray:
    """(n,) the same where laws act at mid-edge nodes too: a twelfth of a six-node facet for its corners, a quarter for these.
    Infinite where there are no facets: what such nodes carry, which are bonded, is no pressure."""
    if not len(interface.triangles):
        return np.full(len(points), np.inf)
    if interface.tied or not interface.matching or interface.triangles.shape[1] == 3:
        return point_areas(points, interface)
    area = np.linalg.norm(area_vectors(points, interface.triangles), axis=1)
    return np.bincount(interface.triangles.ravel(), weights=np.outer(area, [1 / 12] * 3 + [1 / 4] * 3).ravel(), minlength=len(points))


def lawful_corners(interface: Interface) -> np.ndarray:
    """(p,) int, ascending, which of the ``lawful_nodes`` are corners."""
    lawful = lawful_nodes(interface)
    return lawful[np.isin(lawful, interface.corners)]
