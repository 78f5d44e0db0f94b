"""A rigid ground behind surfaces that stand on it: springs, directions that are held, points that surfaces follow.

A ground is a body of its own, a thin layer of tets outside the surface whose nodes are all held, and its law an interface's:
matter's own stiffness still vanishes on rigid motions, and nothing of the method has to know of supports that give. The layer
comes last in the mesh; what the ground exerts is the reaction of its entry of ``boundary``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.conditions.boundary import Held
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import Faces, edge_patches, faces_of
from orchestrator.scene.mesh.geometry import format_point, local_size
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering, split_numbering
from orchestrator.scene.model import BoundaryEntry, Interface
from orchestrator.scene.partition import Partition

GROUND = "ground of boundary"  # its volumes are called so
THICKNESS = 0.1  # of the layer over the size of its faces: it is geometry alone, and does not deform


def add_grounds(mesh: Mesh, partition: Partition, cell_material: np.ndarray, boundary: list[BoundaryEntry], problems: Problems,
                ) -> tuple[Mesh, Partition, SplitNumbering, np.ndarray, list[Interface], dict[int, slice]]:
    """The scene with a ground behind every entry that stands on one.

    boundary : resolved entries
    Returns mesh, partition, its numbering, material of each cell; the interfaces; per entry, the nodes of its ground
    """
    from orchestrator.scene.soles.facets import Facets  # with it comes SciPy, which checks do without
    from orchestrator.scene.soles.make import prisms

    standing = [i for i, entry in enumerate(boundary) if entry.ground and len(entry.triangles)]
    layers, cells, volume, subdomain, material = [mesh.nodes], [mesh.cells], [mesh.volume], [partition.subdomain], [cell_material]
    names, bodies, volumes = list(partition.names), [partition.body(e) for e in range(len(partition.names))], list(mesh.volumes)
    nodes: dict[int, slice] = {}
    for i in standing:
        at, local = _local(boundary[i])
        points, count, first = mesh.nodes[at], len(local), sum(map(len, layers))
        layer = prisms(Facets(points, local, np.ones(count), np.zeros(count), THICKNESS * local_size(points, local)), +1)
        layers.append(np.vstack([points, layer.points]))
        cells.append(layer.cells + first)
        nodes[i] = slice(first, first + len(layers[-1]))
        name = f"{GROUND}[{i}]"
        volume.append(np.full(len(layer.cells), len(volumes)))
        subdomain.append(np.full(len(layer.cells), len(names)))
        material.append(np.repeat(cell_material[boundary[i].cells[:, 0]], 3))
        for known in (names, bodies, volumes):
            known.append(name)
    whole = replace(mesh, nodes=np.concatenate(layers), cells=np.concatenate(cells), volume=np.concatenate(volume), volumes=volumes)
    cut = Partition(np.concatenate(subdomain), names, bodies)
    numbering = split_numbering(whole.cells, cut.subdomain, len(whole.nodes))
    behind = faces_of(whole.cells[:, :4], len(whole.nodes))
    interfaces = [made for i in standing for made in _interfaces(whole, cut, numbering, behind, nodes[i].start, boundary[i], problems)]
    return whole, cut, numbering, np.concatenate(material), interfaces, nodes


def _local(entry: BoundaryEntry) -> tuple[np.ndarray, np.ndarray]:
    """(p,) int, the nodes of an entry's faces, ascending, and these (k, 3 or 6) as indices of them."""
    at, local = np.unique(entry.triangles, return_inverse=True)
    return at, local.reshape(entry.triangles.shape)


def _interfaces(mesh: Mesh, partition: Partition, numbering: SplitNumbering, faces: Faces, first: int, entry: BoundaryEntry,
                problems: Problems) -> list[Interface]:
    """Between each body on a surface and its ground, patch by patch.

    first : first node of the ground
    """
    at, local = _local(entry)
    owner = partition.subdomain[entry.cells[:, 0]]
    ground = int(partition.subdomain[faces.owner[faces.find(local[:1, :3] + first)[0]]])
    group = np.unique(np.c_[owner, edge_patches(local[:, :3])[1]], axis=0, return_inverse=True)[1].ravel() \
        if not entry.ground.whole else owner
    found = []
    for one in np.unique(group):
        chosen = np.flatnonzero(group == one)
        mine, e = np.unique(local[chosen]), int(owner[chosen[0]])
        own = tuple(numbering.find(np.int64(part), ids) - numbering.offsets[part] for part, ids in ((e, at[mine]), (ground, first + mine)))
        cells = np.c_[entry.cells[chosen, 0], faces.owner[faces.find(local[chosen, :3] + first)]]
        found.append(Interface(-1, f"{partition.names[e]} | {partition.names[ground]}", (e, ground), at[mine], own,
                               np.searchsorted(mine, local[chosen]), cells, np.ones((len(mine), 3), dtype=bool)))
    if entry.ground.whole and len(found) > 1:
        problems.add(("boundary", entry.index, "on"), f"a {entry.kind} of a surface that {len(found)} subdomains share",
                     "a surface of one subdomain, that moves as one",
                     "leave its body whole: write subdomains: groups, without split_above or with a larger one")
        return []
    for interface in found:
        laws = entry.ground.laws(mesh.nodes[interface.global_nodes], interface.triangles)
        _govern(interface, laws)
    return found


def _govern(interface: Interface, laws: list) -> None:
    """Give a ground's interface its law at every load step."""
    interface.law = max(laws, key=lambda law: law.imposed)
    interface.law_at_steps = laws if len({tuple(np.ravel(law.given)) for law in laws}) > 1 else []


def within_free(interfaces: Sequence[Interface], held: Held, problems: Problems) -> None:
    """Take components that boundary conditions prescribe out of what the laws of grounds ask for, which must let them.

    interfaces : those of grounds, with what is ``free``
    """
    for i in interfaces:
        moved = np.where(i.free, 0.0, held.values[:, held.numbering.sides(i)[0]])
        laws = [law.within(i.free, there) for law, there in zip(i.laws(len(moved)), moved)]
        if laws[0] is not None:
            _govern(i, laws)
            continue
        where = format_point(held.mesh.nodes[i.global_nodes[np.flatnonzero(~i.free.all(axis=1))[0]]])
        problems.add(("boundary",), f"{i.name}: a node of a coupled surface is prescribed by another entry, at {where}",
                     "surfaces that are coupled and nothing else", "prescribe it by the coupling's displacement and rotation, or select "
                     "surfaces that do not meet")


def held_rows(interfaces: Sequence[Interface], mesh: Mesh) -> list[tuple[int, np.ndarray]]:
    """Per ground, a cell of the body on it and (q, 6) what it keeps from moving: combinations of a translation of the origin and
    a rotation about it."""
    return [(int(i.cells[0, 0]), i.law.keeps(motions_about(mesh.nodes[i.global_nodes], np.zeros(3), 1.0))) for i in interfaces]
