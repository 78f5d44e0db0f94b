"""Loose bodies: those that nothing but contact could hold; interfaces that join bodies wholly, or in single points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.scene.conditions.rigid import Hinge, left_over, motions_about
from orchestrator.scene.conditions.supports import ORIGIN, Supports
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.model import Scene, Subdomain
from orchestrator.scene.partition import Partition


def loose_bodies(scene: Scene) -> np.ndarray:
    """(subdomains,) bool, those that can move as rigid bodies, together with what joining laws tie to them.

    What contact may do for them depends on the load, and is not looked at: a block that is pressed on another one and
    rubs is loose. A ground keeps from happening what its law says: a point that is pushed by a force holds nothing along it.
    """
    if scene.overview is not None:
        return scene.overview.loose
    return with_grounds(scene, scene.subdomains).loose(ends_of(i for i in scene.interfaces if i.law.joins and not i.law.on_ground))


def with_grounds(scene: Scene, own: Sequence[Subdomain]) -> Supports:
    """What supports and grounds keep subdomains from, whose nodes are all there."""
    kept: dict[int, list[np.ndarray]] = {}
    for i in scene.interfaces:
        if i.law.on_ground:
            kept.setdefault(i.subdomains[0], []).append(i.law.keeps(motions_about(scene.mesh.nodes[i.global_nodes], *ORIGIN)))
    return Supports.of(scene, own, kept)


SHARED = "an edge that bodies share is a hinge, and a corner less"


def joins(mesh: Mesh, partition: Partition, interfaces: Sequence[Interface]) -> tuple[list[np.ndarray], list[Hinge]]:
    """Cells (k, 2) on both sides of interfaces that join wholly, and the others.

    Under laws that press the sides are taken to hold each other: what they carry depends on the load.
    """
    first = np.unique(partition.subdomain, return_index=True)[1]
    whole, hinges = [], []
    for i in interfaces:
        points, cure = mesh.nodes[i.global_nodes], SHARED
        if len(i.triangles):
            if i.mortar is None or i.law.presses or not len(i.mortar):  # sides without any point are told of elsewhere
                whole.append(i.cells)
                continue
            points = (i.mortar.first @ points.ravel()).reshape(-1, 3)
            if not left_over(points, np.ones(points.shape, dtype=bool)).shape[1]:
                whole.append(i.cells)
                continue
            many = "one point carries" if len(points) == 1 else f"{len(points)} points in a line carry"
            cure = (f"{i.name} have so little in common beside the size of their facets that {many}, at "
                    f"{format_point(points.mean(axis=0))}: mesh both finer there")
        hinges.append(Hinge(tuple(int(first[e]) for e in i.subdomains), points, cure))
    return whole, hinges
