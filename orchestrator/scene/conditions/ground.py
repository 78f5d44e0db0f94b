"""A rigid ground behind surfaces that stand on it: springs, directions that are held, points that surfaces follow.

A ground is a body of its own, a thin layer of tets outside the surface whose nodes are all held, and its law an interface's:
matter's own stiffness still vanishes on rigid motions, and nothing of the method has to know of supports that give. The layer
comes last in the mesh; what the ground exerts is the reaction of its entry of ``boundary``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.registry import GROUND
from orchestrator.scene.conditions.frames import Cylindrical
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import Faces, edge_patches, faces_of
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.patch import local_size, node_normals
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Interface
from orchestrator.scene.partition.numbering import SplitNumbering, split_numbering
from orchestrator.scene.partition.partition import Partition

THICKNESS = 0.1  # of the layer over the size of its faces: it is geometry alone, and does not deform


def add_grounds(mesh: Mesh, faces: Faces, partition: Partition, cell_material: np.ndarray, entries: Sequence[Any],
                boundary: list[BoundaryEntry], vectors: Sequence[Any], factors: Sequence[Sequence[float]],
                problems: Problems) -> tuple[Mesh, Partition, SplitNumbering, np.ndarray, list[Interface], dict[int, slice]]:
    """The scene with a ground behind every entry that stands on one.

    Parameters
    ----------
    boundary : resolved entries; vectors : per entry (steps, 3) or None; factors : per entry (steps,)

    Returns
    -------
    mesh, partition, its numbering, material of each cell; the interfaces; per entry, the nodes of its ground
    """
    from orchestrator.scene.soles.facets import Facets  # with it comes SciPy, which checks do without
    from orchestrator.scene.soles.prisms import prisms

    standing = [i for i, entry in enumerate(entries) if entry.stands and len(boundary[i].triangles)]
    layers, cells, volume, subdomain, material = [mesh.nodes], [mesh.cells], [mesh.volume], [partition.subdomain], [cell_material]
    names, bodies, volumes = list(partition.names), [partition.body(e) for e in range(len(partition.names))], list(mesh.volumes)
    nodes: dict[int, slice] = {}
    corner: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # per entry: the body's nodes, triangles among them
    for i in standing:
        at, local = np.unique(boundary[i].triangles, return_inverse=True)
        local = local.reshape(boundary[i].triangles.shape)
        points, count, first = mesh.nodes[at], len(local), sum(map(len, layers))
        layer = prisms(Facets(points, local, np.ones(count), np.zeros(count), THICKNESS * local_size(points, local)), +1)
        layers.append(np.vstack([points, layer.points]))
        cells.append(layer.cells + first)
        nodes[i], corner[i] = slice(first, first + len(layers[-1])), (at, local)
        name = f"ground of boundary[{i}]"
        volume.append(np.full(len(layer.cells), len(volumes)))
        subdomain.append(np.full(len(layer.cells), len(names)))
        material.append(np.repeat(cell_material[boundary[i].cells[:, 0]], 3))
        for known in (names, bodies, volumes):
            known.append(name)
    whole = replace(mesh, nodes=np.concatenate(layers), cells=np.concatenate(cells), volume=np.concatenate(volume), volumes=volumes)
    cut = Partition(np.concatenate(subdomain), names, bodies)
    numbering = split_numbering(whole.cells, cut.subdomain, len(whole.nodes))
    behind = faces_of(whole.cells[:, :4], len(whole.nodes))
    interfaces = [made for i in standing for made in _interfaces(
        whole, cut, numbering, behind, nodes[i].start, *corner[i], boundary[i], entries[i], vectors[i], factors[i], problems)]
    return whole, cut, numbering, np.concatenate(material), interfaces, nodes


def _interfaces(mesh: Mesh, partition: Partition, numbering: SplitNumbering, faces: Faces, first: int, at: np.ndarray,
                local: np.ndarray, resolved: BoundaryEntry, entry: Any, rows: Any, factors: Sequence[float],
                problems: Problems) -> list[Interface]:
    """Between each body on a surface and its ground, patch by patch.

    Parameters
    ----------
    first : first node of the ground; at : (p,) the surface's nodes; local : (k, 3 or 6) its triangles among them
    """
    owner = partition.subdomain[resolved.cells[:, 0]]
    ground = int(partition.subdomain[faces.owner[faces.find(local[:1, :3] + first)[0]]])
    group = np.unique(np.c_[owner, edge_patches(local[:, :3])[1]], axis=0, return_inverse=True)[1].ravel() \
        if entry.coupling is None else owner
    found = []
    for one in np.unique(group):
        chosen = np.flatnonzero(group == one)
        mine, e = np.unique(local[chosen]), int(owner[chosen[0]])
        own = tuple(numbering.find(np.int64(part), ids) - numbering.offsets[part] for part, ids in ((e, at[mine]), (ground, first + mine)))
        cells = np.c_[resolved.cells[chosen, 0], faces.owner[faces.find(local[chosen, :3] + first)]]
        found.append(Interface(-1, f"{partition.names[e]} | {partition.names[ground]}", (e, ground), at[mine], own,
                               np.searchsorted(mine, local[chosen]), cells, np.ones((len(mine), 3), dtype=bool)))
    if entry.coupling is not None and len(found) > 1:
        problems.add(("boundary", resolved.index, "on"), f"a coupling of a surface that {len(found)} subdomains share",
                     "a surface of one subdomain, that moves as one", "leave its body whole: write subdomains: groups, without split_above or "
                     "with a larger one")
        return []
    for interface in found:
        laws = _coupling(mesh, interface, entry.coupling, factors) if entry.coupling is not None else \
            _support(mesh, interface, entry, rows, factors, resolved.index, problems)
        _govern(interface, laws)
    return found


def _govern(interface: Interface, laws: list) -> None:
    """Give a ground's interface its law at every load step."""
    interface.law = max(laws, key=lambda law: law.imposed)
    interface.law_at_steps = laws if len({tuple(np.ravel(law.given)) for law in laws}) > 1 else []


def _support(mesh: Mesh, interface: Interface, entry: Any, rows: Any, factors: Sequence[float], index: int, problems: Problems) -> list:
    """The law at every load step of springs, or of directions that are held."""
    points, count = mesh.nodes[interface.global_nodes], len(interface.global_nodes)
    normal, frame = node_normals(points, interface.triangles), Cylindrical.of(entry.frame)
    bed = entry.foundation
    if frame is not None and (bed is not None or any(x is not None for x in rows[0][:2])):
        frame.check(points, interface.triangles, ("boundary", index, "frame"), problems)
    directions = np.broadcast_to(np.eye(3), (count, 3, 3)) if frame is None else frame.directions(points)
    if bed is None:
        held = np.array([x is not None for x in rows[0]])
        stiffness = np.where(held, np.inf, 0.0)
        given = np.array([[0.0 if x is None else x for x in row] for row in rows])
    else:
        stiffness, given = np.array(bed.stiffness or [bed.normal, bed.tangential or 0.0, bed.tangential or 0.0]), np.zeros((len(factors), 3))
        if bed.stiffness is None:
            across = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
            across /= np.linalg.norm(across, axis=1, keepdims=True)
            directions = np.stack([normal, across, np.cross(normal, across)], axis=1)
    made = GROUND["support"]
    return [made(np.ascontiguousarray(directions.transpose(1, 2, 0)), np.repeat(stiffness[:, None], count, axis=1),
                 np.repeat(row[:, None], count, axis=1), normal.T) for row in given]


def _coupling(mesh: Mesh, interface: Interface, coupling: Any, factors: Sequence[float]) -> list:
    """The law at every load step of a point that the surface follows."""
    points = mesh.nodes[interface.global_nodes]
    area = np.linalg.norm(area_vectors(points, interface.triangles), axis=1)
    about = area @ points[interface.triangles[:, :3]].mean(axis=1) / area.sum() if coupling.about is None else np.array(coupling.about, dtype=float)
    motions = motions_about(points, about, 1.0).transpose(2, 1, 0)
    amounts = [*coupling.displacement, *(None if x is None else np.radians(x) for x in coupling.rotation)]
    prescribed = np.array([x is not None for x in amounts])
    given = np.where(prescribed, [x or 0.0 for x in amounts], [*coupling.force, *coupling.moment])
    return [GROUND["coupling"](np.ascontiguousarray(motions), prescribed, factor * given, coupling.kind == "rigid") for factor in factors]


def within_free(interfaces: Sequence[Interface], mesh: Mesh, numbering: SplitNumbering, prescribed: np.ndarray, problems: Problems) -> None:
    """Take components that boundary conditions prescribe out of what the laws of grounds ask for, which must let them.

    Parameters
    ----------
    interfaces : those of grounds, with what is ``free``
    prescribed : (steps, N, 3) on split nodes
    """
    for i in interfaces:
        moved = np.where(i.free, 0.0, prescribed[:, numbering.offsets[i.subdomains[0]] + i.nodes[0]])
        laws = [law.within(i.free, held) for law, held in zip(i.law_at_steps or [i.law] * len(moved), moved)]
        if laws[0] is not None:
            _govern(i, laws)
            continue
        where = format_point(mesh.nodes[i.global_nodes[np.flatnonzero(~i.free.all(axis=1))[0]]])
        problems.add(("boundary",), f"{i.name}: a node of a coupled surface is prescribed by another entry, at {where}",
                     "surfaces that are coupled and nothing else", "prescribe it by the coupling's displacement and rotation, or select "
                     "surfaces that do not meet")


def held_rows(interfaces: Sequence[Interface], mesh: Mesh) -> list[tuple[int, np.ndarray]]:
    """Per ground, a cell of the body on it and (q, 6) what it keeps from moving: combinations of a translation of the origin and
    a rotation about it."""
    return [(int(i.cells[0, 0]), i.law.keeps(motions_about(mesh.nodes[i.global_nodes], np.zeros(3), 1.0))) for i in interfaces]
