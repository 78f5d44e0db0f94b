"""What interfaces are sought in: a divided mesh, under which laws, and where problems are told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.mortar.surfaces import Matter
from orchestrator.scene.interfaces.opposite import Body, outer_bodies
from orchestrator.scene.interfaces.overlap import Overlap, Solid, overlap
from orchestrator.scene.interfaces.skins import Skins, bulges, sagittas
from orchestrator.scene.mesh.faces import Faces, components, pack, pieces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface
from orchestrator.scene.mesh.mesh import SplitNumbering
from orchestrator.scene.partition import Partition


@dataclass
class Search:
    """A divided mesh, and what interfaces in it go by.

    mesh, faces, partition, numbering : the mesh, its faces, its subdomains, and their own numbers of nodes
    laws : the entries of ``interfaces:`` in the YAML
    problems : where what is wrong is told
    asked : whether the user has written the entries; what is near without an interface is a mistake then
    matter : what chooses slaves where nodes do not match; None: such faces are no interface
    slaves : of pairs of bodies that are cut further, the names of those whose pieces are the slaves, once chosen
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    numbering: SplitNumbering
    laws: Laws
    problems: Problems
    asked: bool = True
    matter: Matter | None = None
    slaves: dict[tuple[str, str], str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._solid = lru_cache(maxsize=None)(lambda v: Solid(
            self.mesh.nodes, self.mesh.cells[self.mesh.volume == v],
            self.faces.triangles[self.faces.outer[self.mesh.volume[self.faces.owner[self.faces.outer]] == v]]))

    @cached_property
    def bodies(self) -> list[Body]:
        """The outer faces, by subdomain and volume; none where there is a single volume."""
        return outer_bodies(self.mesh, self.faces, self.partition.subdomain) if len(self.mesh.volumes) > 1 else []

    @cached_property
    def skins(self) -> Skins:
        """The surfaces that the bodies' faces stand for."""
        return Skins(self.mesh, self.faces)

    @cached_property
    def pieces(self) -> tuple[int, np.ndarray]:
        """Number of pieces of the mesh that share no faces with each other, and the piece (m,) of each tet."""
        return pieces(self.faces, np.zeros(len(self.mesh.cells), dtype=int))

    def inside(self, one: int, two: int) -> Overlap | None:
        """How deep two volumes are in each other; None: not worth mentioning."""
        both = [self._solid(v) for v in (one, two)]
        if overlap(*both) is None:
            return None
        # worth a closer look: curved faces of coarse chords may be meant to touch
        return overlap(*both, tuple(sagittas(bulges(s.nodes, s.outer, self.skins.smooth[self.faces.find(s.outer[:, :3])])) for s in both))

    def names(self, sides: tuple[int, int]) -> tuple[str, str]:
        """Names of two subdomains."""
        return self.partition.names[sides[0]], self.partition.names[sides[1]]

    def known(self, body: Body) -> tuple[str, str]:
        """What an entry may call a body: its subdomain's name, and its volume's."""
        return self.partition.names[body.subdomain], self.mesh.volumes[body.volume]

    def called(self, sides: tuple[int, int], volumes: Sequence[np.ndarray]) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """What an entry may call two subdomains that meet with cells of some volumes.

        Inside one volume only the subdomains' names count: a law for a part against all others is not meant for
        the cuts within that part.
        """
        within = len(self.mesh.volumes) == 1 or len(np.intersect1d(*volumes))
        return tuple((name, *(() if within else (self.mesh.volumes[v] for v in own))) for name, own in zip(self.names(sides), volumes))

    def cut_further(self, body: Body) -> bool:
        """Whether a body is a piece of a larger one."""
        return self.partition.body(body.subdomain) != self.partition.names[body.subdomain]

    def interface(self, sides: tuple[int, int], nodes: tuple[np.ndarray, np.ndarray], triangles: np.ndarray, cells: np.ndarray,
                  **more: Any) -> Interface:
        """An interface of subdomains, of global nodes (n₁,) and (n₂,) on either side; all components count as free."""
        own = tuple(self.numbering.find(np.int64(e), ids) - self.numbering.offsets[e] for e, ids in zip(sides, nodes))
        return Interface(-1, " | ".join(self.names(sides)), sides, nodes[0], own, triangles, cells,
                         np.ones((len(nodes[0]), 3), dtype=bool), **more)


def bonded(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(N,) int, label of each split node: equal where perfect interfaces of paired nodes make them one."""
    pairs = [numbering.sides(i) for i in interfaces if i.law.perfect and i.matching]
    one, two = (np.concatenate([np.empty(0, int), *side]) for side in (zip(*pairs) if pairs else ((), ())))
    return components(one, two, len(numbering.nodes))[1]


def paired_faces(numbering: SplitNumbering, interfaces: Iterable[Interface]) -> np.ndarray:
    """(k,) keys of the outer faces, of ``pack``, that interfaces pair with others; shared faces are no outer ones."""
    keys = [np.empty(0, np.int64)]
    for i in interfaces:
        if i.surfaces is not None:
            met = (np.unique(own) for own in (i.surfaces.segments.slave, i.surfaces.segments.master))
            sides = zip(i.surfaces.nodes, (t[own] for t, own in zip(i.surfaces.triangles, met)))
        else:
            nodes = [numbering.nodes[own] for own in numbering.sides(i)]
            sides = zip(nodes, 2 * [i.triangles]) if not np.array_equal(*nodes) else ()
        keys += [pack(nodes[triangles[:, :3]], numbering.total) for nodes, triangles in sides]
    return np.concatenate(keys)
