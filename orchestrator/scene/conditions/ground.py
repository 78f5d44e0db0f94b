"""A rigid ground behind surfaces that stand on it: springs, directions that are held, points that
surfaces follow.

A ground is a body of its own, a thin layer of tets outside the surface whose nodes are all held,
and its law an interface's: matter's own stiffness still vanishes on rigid motions, and nothing of
the method has to know of supports that give. Behind each subdomain it is a subdomain of its own,
which no other one touches. The layers come last in the mesh; what they exert is the reaction of
their entry of ``boundary``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.body import Divided
from orchestrator.scene.conditions.boundary import Held
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import edge_patches, faces_of, renumbered
from orchestrator.scene.mesh.geometry import format_point, local_size
from orchestrator.scene.mesh.mesh import Mesh, split_numbering
from orchestrator.scene.mesh.quadratic import faces_of_six
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import BoundaryEntry
from orchestrator.scene.partition import Partition

GROUND = "ground of boundary"  # its volumes are called so
# of the layer over the size of its faces: it is geometry alone, and does not deform
THICKNESS = 0.1


@dataclass(frozen=True)
class Layer:
    """Layer to lie behind some faces.

    name : of the subdomain that it is
    triangles : (k, 3 or 6) int, outward; cells : (k,) int, the tet behind each
    whole : it is one interface with each body, in however many patches
    thickness : over the size of its faces
    """

    name: str
    triangles: np.ndarray
    cells: np.ndarray
    whole: bool = False
    thickness: float = THICKNESS


def add_layers(cut: Divided, wanted: Mapping[str, Sequence[Layer]],
               ) -> tuple[Divided, list[slice], list[list[Interface]]]:
    """Return a scene with a thin layer of tets behind faces each, a subdomain of its own with nodes
    of its own.

    wanted : name of a body, which the mesh has as a volume, → its layers, maybe none
    Returns also the nodes of each body's layers, each layer's on the faces first; and the
    interfaces with what they lie on, without a law
    """
    # with it comes SciPy, which checks do without
    from orchestrator.scene.soles.facets import Facets
    from orchestrator.scene.soles.make import prisms

    body, partition = cut.body, cut.partition
    mesh, names = body.mesh, list(partition.names)
    layers, cells, volume, subdomain, material = (
        [x] for x in (mesh.nodes, mesh.cells, mesh.volume, partition.subdomain, body.material))
    bodies = [partition.body(e) for e in range(len(names))]
    nodes, firsts = [], [len(mesh.nodes)]
    for number, (name, several) in enumerate(wanted.items(), len(mesh.volumes)):
        begin = firsts[-1]
        for one in several:
            at, local = renumbered(one.triangles)
            points, count = mesh.nodes[at], len(local)
            layer = prisms(Facets(points, local, np.ones((count, 3)), np.zeros(count),
                                  one.thickness * local_size(points, local)), +1)
            layers += [points, layer.points]
            cells.append(layer.cells + firsts[-1])
            firsts.append(firsts[-1] + len(points) + len(layer.points))
            volume.append(np.full(len(layer.cells), number))
            subdomain.append(np.full(len(layer.cells), len(names)))
            material.append(np.repeat(body.material[one.cells], 3))
            names.append(one.name)
            bodies.append(name)
        nodes.append(slice(begin, firsts[-1]))
    nodes_of, cells, volume, subdomain, material = map(
        np.concatenate, (layers, cells, volume, subdomain, material))
    whole = replace(mesh, nodes=nodes_of, cells=cells, volume=volume,
                    volumes=[*mesh.volumes, *wanted])
    faces = faces_of(cells[:, :4], len(nodes_of))
    faces = faces if cells.shape[1] == 4 else faces_of_six(faces, cells)
    added = replace(cut, body=replace(body, mesh=whole, faces=faces, material=material),
                    partition=Partition(subdomain, names, bodies),
                    numbering=split_numbering(cells, subdomain, len(nodes_of)))
    starts = iter(firsts)
    return added, nodes, [[i for one in several
                           for i in _interfaces(added, next(starts), name, one)]
                          for name, several in wanted.items()]


def _interfaces(cut: Divided, first: int, body: str, layer: Layer) -> Iterator[Interface]:
    """Between each body on a surface and the layer behind it, patch by patch.

    first : first node of the layer
    """
    partition, numbering, faces = cut.partition, cut.numbering, cut.body.faces
    at, local = renumbered(layer.triangles)
    behind = faces.owner[faces.find(local[:, :3] + first)]
    owner, ground = partition.subdomain[layer.cells], int(partition.subdomain[behind[0]])
    group = owner if layer.whole else np.unique(np.c_[owner, edge_patches(local[:, :3])[1]], axis=0,
                                                return_inverse=True)[1].ravel()
    for one in np.unique(group):
        chosen = np.flatnonzero(group == one)
        mine, e = np.unique(local[chosen]), int(owner[chosen[0]])
        own = tuple(numbering.find(np.int64(part), ids) - numbering.offsets[part]
                    for part, ids in ((e, at[mine]), (ground, first + mine)))
        yield Interface(-1, f"{partition.names[e]} | {body}", (e, ground), at[mine], own,
                        np.searchsorted(mine, local[chosen]),
                        np.c_[layer.cells[chosen], behind[chosen]],
                        np.ones((len(mine), 3), dtype=bool))


def add_grounds(cut: Divided, boundary: list[BoundaryEntry], problems: Problems,
                ) -> tuple[Divided, list[tuple[int, Interface]], dict[int, slice]]:
    """Return the scene with a ground behind every entry that stands on one.

    boundary : resolved entries
    Returns also the interfaces with grounds, with their laws, and the entry of each; and per entry
    the nodes of its grounds
    """
    standing = [entry for entry in boundary if entry.ground]
    layers = {f"ground of {entry.name}": list(_behind(entry, cut.partition)) for entry in standing}
    added, nodes, between = add_layers(cut, layers)
    interfaces, stands = [], {}
    for entry, own, there, found in zip(standing, layers.values(), nodes, between):
        if entry.ground.whole and len(own) > 1:
            problems.add(
                ("boundary", entry.index, "on"),
                f"a {entry.kind} of a surface that {len(own)} subdomains share",
                "a surface of one subdomain, that moves as one",
                "leave its body whole: write subdomains: groups, without split_above or with a "
                "larger one")
            continue
        for interface in found:
            points = added.body.mesh.nodes[interface.global_nodes]
            _govern(interface, entry.ground.laws(points, interface.triangles))
            interface.ground = True
            interfaces.append((entry.index, interface))
        if own:
            stands[entry.index] = there
    return added, interfaces, stands


def _behind(entry: BoundaryEntry, partition: Partition) -> Iterator[Layer]:
    """One layer behind each subdomain that has faces of an entry."""
    owner = partition.subdomain[entry.cells[:, 0]]
    for e in np.unique(owner):
        own = owner == e
        yield Layer(f"ground of {entry.name} behind {partition.names[e]}", entry.triangles[own],
                    entry.cells[own, 0], entry.ground.whole)


def _govern(interface: Interface, laws: list) -> None:
    """Give a ground's interface its law at every load step."""
    interface.govern(laws, len({tuple(np.ravel(law.given)) for law in laws}) > 1)


def within_free(interfaces: Sequence[Interface], held: Held, problems: Problems) -> None:
    """Take components that boundary conditions prescribe out of what the laws of grounds ask for,
    which must let them.

    interfaces : those of grounds, with what is ``free``
    """
    for i in interfaces:
        moved = np.where(i.free, 0.0, held.values[:, held.numbering.sides(i)[0]])
        laws = [law.within(i.free, there) for law, there in zip(i.laws(len(moved)), moved)]
        if laws[0] is not None:
            _govern(i, laws)
            continue
        where = format_point(
            held.mesh.nodes[i.global_nodes[np.flatnonzero(~i.free.all(axis=1))[0]]])
        problems.add(("boundary",),
                     f"{i.name}: a node of a coupled surface is prescribed by another entry, at "
                     f"{where}",
                     "surfaces that are coupled and nothing else",
                     "prescribe it by the coupling's displacement and rotation, or select "
                     "surfaces that do not meet")


def held_rows(interfaces: Sequence[Interface], mesh: Mesh) -> list[tuple[int, np.ndarray]]:
    """Per ground, a cell of the body on it and (q, 6) what it keeps from moving: combinations of a
    translation of the origin and
    a rotation about it."""
    return [
        (int(i.cells[0, 0]),
         i.law.keeps(motions_about(mesh.nodes[i.global_nodes], np.zeros(3), 1.0)))
        for i in interfaces]
