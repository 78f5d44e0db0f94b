"""What interfaces join wholly, and what by single points alone.

Sides whose nodes match are joined by facets, of three nodes each. Where they do not match, points carry: where bodies overlap
on a part of a facet there may be one or two, which leave bodies a rotation about a point or about a line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.scene.conditions.rigid import Hinge, left_over
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.partition.partition import Partition

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
