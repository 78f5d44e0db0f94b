"""A mesh cut into subdomains, as the search for interfaces sees it: bodies, skins, names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from orchestrator.kept import Unchanging
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.overlap import Hidden, hidden, Overlap, overlap, Solid
from orchestrator.scene.interfaces.opposite import BodyFaces, outer_bodies
from orchestrator.scene.interfaces.skins import Skins, surface_of
from orchestrator.scene.mesh.faces import components, Faces, pack, pieces
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.partition import Partition


@dataclass(frozen=True)
class Parts(Unchanging):
    """A mesh cut into subdomains.

    mesh, faces, partition, numbering : the mesh, its faces, its subdomains, and their own numbers
        of nodes
    young : (m,) modulus of each cell, by which slaves are chosen where nodes do not match
    held : (n, 3) bool, components of nodes that are prescribed
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    numbering: SplitNumbering
    young: np.ndarray
    held: np.ndarray

    @cached_property
    def bodies(self) -> list[BodyFaces]:
        """The outer faces, by subdomain and volume; none where there is a single volume."""
        if len(self.mesh.volumes) < 2:
            return []
        return outer_bodies(self.mesh, self.faces, self.partition.subdomain)

    @cached_property
    def skins(self) -> Skins:
        """The surfaces that the bodies' faces stand for."""
        return Skins(self.mesh, self.faces, self.held)

    def hidden(self, one: BodyFaces, two: BodyFaces) -> Hidden:
        """Return the test whether another body is between faces of two."""
        return hidden(self.bodies, self.skins, one, two)

    @cached_property
    def pieces(self) -> tuple[int, np.ndarray]:
        """Number of pieces of the mesh that share no faces with each other, and the piece (m,) of
        each tet."""
        return pieces(self.faces, np.zeros(len(self.mesh.cells), dtype=int))

    @cached_property
    def _solid(self) -> Callable[[int], Solid]:
        mesh, faces = self.mesh, self.faces  # with self in it, it would refer to itself

        @cache
        def solid(v: int) -> Solid:
            own = mesh.volume == v
            outer = faces.outer[own[faces.owner[faces.outer]]]
            return Solid(mesh.nodes, mesh.cells[own], faces.triangles[outer])

        return solid

    def inside(self, one: int, two: int) -> Overlap | None:
        """Return the depth of two volumes in each other; None: not worth mentioning."""
        both = [self._solid(v) for v in (one, two)]
        if overlap(*both) is None:
            return None
        # worth a closer look: curved faces of coarse chords may be meant to touch
        smooth = (self.skins.smooth[self.faces.find(s.outer[:, :3])] for s in both)
        return overlap(*both, tuple(surface_of(s.nodes, s.outer, faces).sagitta
                                    for s, faces in zip(both, smooth)))

    def names(self, sides: tuple[int, int]) -> tuple[str, str]:
        """Return the names of two subdomains."""
        return tuple(self.partition.names[e] for e in sides)

    def known(self, body: BodyFaces) -> tuple[str, str]:
        """Return the names by which an entry may call a body: its subdomain's and its volume's."""
        return self.partition.names[body.subdomain], self.mesh.volumes[body.volume]

    def called(self, sides: tuple[int, int],
               volumes: Sequence[np.ndarray]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names by which an entry may call two subdomains that meet with cells of some
        volumes.

        Inside one volume only the subdomains' names count: a law for a part against all others is
        not meant for the cuts within that part.
        """
        within = len(self.mesh.volumes) == 1 or len(np.intersect1d(*volumes))
        return tuple((name, *(() if within else (self.mesh.volumes[v] for v in own)))
                     for name, own in zip(self.names(sides), volumes))

    def cut_further(self, body: BodyFaces) -> bool:
        """Return whether a body is a piece of a larger one."""
        return self.partition.body(body.subdomain) != self.partition.names[body.subdomain]

    def interface(self, sides: tuple[int, int], nodes: tuple[np.ndarray, np.ndarray],
                  triangles: np.ndarray, cells: np.ndarray, **more: Any) -> Interface:
        """Return an interface of subdomains, of global nodes (n₁,) and (n₂,) on either side; all
        components count as free."""
        own = tuple(self.numbering.find(np.int64(e), ids) - self.numbering.offsets[e]
                    for e, ids in zip(sides, nodes))
        return Interface(-1, " | ".join(self.names(sides)), sides, nodes[0], own, triangles, cells,
                         np.ones((len(nodes[0]), 3), dtype=bool), **more)


def bonded(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(N,) int, label of each split node: equal where perfect interfaces of paired nodes make them
    one.
    """
    pairs = [numbering.sides(i) for i in interfaces if i.law.perfect and i.matching]
    one, two = (np.concatenate([np.empty(0, int), *side])
                for side in (zip(*pairs) if pairs else ((), ())))
    return components(one, two, len(numbering.nodes))[1]


def paired_faces(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(k,) keys of the outer faces, of ``pack``, that interfaces pair with others; shared faces are
    no outer ones.
    """
    keys = [np.empty(0, np.int64)]
    for i in interfaces:
        if i.surfaces is not None:
            met = (np.unique(own)
                   for own in (i.surfaces.segments.slave, i.surfaces.segments.master))
            sides = zip(i.surfaces.nodes, (t[own] for t, own in zip(i.surfaces.triangles, met)))
        else:
            nodes = [numbering.nodes[own] for own in numbering.sides(i)]
            sides = zip(nodes, 2 * [i.triangles]) if not np.array_equal(*nodes) else ()
        keys += [pack(nodes[triangles[:, :3]], numbering.total) for nodes, triangles in sides]
    return np.concatenate(keys)
