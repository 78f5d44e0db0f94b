"""Which components boundary conditions leave free on interfaces; those without any are none."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.registry import LAWS
from orchestrator.scene.interfaces.search import side_nodes
from orchestrator.scene.mesh.faces import edge_patches
from orchestrator.scene.mesh.geometry import node_normals
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.model import Interface
from orchestrator.scene.partition import Partition


def leave_free(mesh: Mesh, found: list[Interface], partition: Partition, numbering: SplitNumbering, fixed: np.ndarray,
               entries: list[Any], problems: Problems) -> list[Interface]:
    """The interfaces on which something is to be found, numbered, with ``free`` and the normals of whole bodies.

    Patches on which everything is prescribed on both sides are left out.

    found : all interfaces
    fixed : (N, 3) bool, prescribed components of split nodes
    entries : of ``interfaces:`` in the YAML
    """
    kept: list[Interface] = []
    if any(i.surfaces is not None for i in found):
        from orchestrator.scene.interfaces.carrying import give_operators

        give_operators(found, fixed, numbering, [partition.body(i) for i in range(len(partition.names))], problems)
    for interface in found:
        if interface.mortar is not None:
            if not len(interface.mortar) and not (interface.free.any() or interface.mortar.free.any()):
                continue
            interface.index = len(kept)
            kept.append(interface)
            if not len(interface.mortar):
                problems.add(("interfaces", interface.entry), f"no node of {partition.names[interface.subdomains[0]]}, the slave of "
                             f"{interface.name}, is free in all components: nothing would carry the interface",
                             "on one side, nodes on which boundary conditions prescribe nothing",
                             f"slave: {partition.names[interface.subdomains[1]]}, more than one element across, or meshes that match")
            continue
        one, two = (fixed[numbering.offsets[e] + own] for e, own in zip(interface.subdomains, interface.nodes))
        interface.free = ~(one & two)
        if interface.free.any():
            interface.index = len(kept)
            kept.append(interface)
    for entry in sorted({i.entry for i in found} - {i.entry for i in kept}):
        if entry >= 0 and not LAWS[entries[entry].law].perfect:
            problems.add(("interfaces", entry, "law"),
                         f"{entries[entry].law}, where boundary conditions prescribe every node on both sides",
                         "interfaces with nodes that are free to open or slip", "hold the parts elsewhere, or leave the law out")
    _number_patches(kept)
    bodies = [partition.body(i) for i in range(len(partition.names))]
    if len(set(bodies)) < len(bodies):
        _share_normals(mesh, numbering, kept, bodies)
    return kept


def _number_patches(found: list[Interface]) -> None:
    """Adds "(patch 1)", "(patch 2)" … to the names of pairs that touch in several places."""
    by_pair: dict[tuple[int, int], list[Interface]] = {}
    for interface in found:
        by_pair.setdefault(interface.subdomains, []).append(interface)
    for group in by_pair.values():
        if len(group) > 1:
            for number, interface in enumerate(group, start=1):
                interface.name += f" (patch {number})"


def _share_normals(mesh: Mesh, numbering: SplitNumbering, interfaces: list[Interface], bodies: list[str]) -> None:
    """Sets ``normals`` of all interfaces with a law between bodies of which one is cut further.

    At a node where pieces of one surface meet, each piece alone has another normal, and what may slide along one is
    stopped by the other. So the normals come from the surface as it is between the whole bodies.

    bodies : per subdomain, the name of its body; the pieces of a body follow one another
    """
    surfaces: dict[tuple[str, str], list[Interface]] = {}
    for i in interfaces:
        if not i.law.perfect and i.matching:
            surfaces.setdefault(tuple(bodies[e] for e in i.subdomains), []).append(i)
    for pieces in surfaces.values():
        if len(pieces) > 1:
            _share(mesh, numbering, pieces)


def _share(mesh: Mesh, numbering: SplitNumbering, pieces: list[Interface]) -> None:
    ends = np.cumsum([0] + [len(i.triangles) for i in pieces])
    triangles = np.concatenate([i.global_nodes[i.triangles] for i in pieces])
    patch = edge_patches(triangles)[1]
    # a node in which two patches only touch has a normal in each of them
    keys, local = np.unique(patch[:, None] * np.int64(len(mesh.nodes)) + triangles, return_inverse=True)
    points = np.empty((len(keys), 3))
    at = []
    for i, first in zip(pieces, ends[:-1]):
        at.append(np.searchsorted(keys, patch[first] * np.int64(len(mesh.nodes)) + i.global_nodes))
        one, two = side_nodes(numbering, i)
        points[at[-1]] = 0.5 * (mesh.nodes[one] + mesh.nodes[two])
    normals = node_normals(points, local.reshape(triangles.shape))
    for i, own in zip(pieces, at):
        i.normals = normals[own]
