"""What interfaces are sought in: a divided mesh, under which laws, and where problems are told."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.entries import Laws
from orchestrator.scene.interfaces.mortar.surfaces import Matter
from orchestrator.scene.interfaces.pairing import Body, outer_bodies
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.model import Interface
from orchestrator.scene.partition import Partition


@dataclass
class Search:
    """A divided mesh, and what interfaces in it go by.

    mesh, faces, partition, numbering : the mesh, its faces, its subdomains, and their own numbers of nodes
    laws : the entries of ``interfaces:`` in the YAML
    problems : where what is wrong is told
    asked : whether the user has written the entries; what is near without an interface is a mistake then
    matter : what chooses slaves where nodes do not match; None: such faces are no interface
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    numbering: SplitNumbering
    laws: Laws
    problems: Problems
    asked: bool = True
    matter: Matter | None = None

    @cached_property
    def bodies(self) -> list[Body]:
        """The outer faces, by subdomain and volume; none where there is a single volume."""
        return outer_bodies(self.mesh, self.faces, self.partition.subdomain) if len(self.mesh.volumes) > 1 else []

    @cached_property
    def pieces(self) -> tuple[int, np.ndarray]:
        """Number of pieces of the mesh that share no faces with each other, and the piece (m,) of each tet."""
        return pieces(self.faces, np.zeros(len(self.mesh.cells), dtype=int))

    def names(self, sides: tuple[int, int]) -> tuple[str, str]:
        """Names of two subdomains."""
        return self.partition.names[sides[0]], self.partition.names[sides[1]]

    def known(self, body: Body) -> tuple[str, str]:
        """What an entry may call a body: its subdomain's name, and its volume's."""
        return self.partition.names[body.subdomain], self.mesh.volumes[body.volume]

    def cut_further(self, body: Body) -> bool:
        """Whether a body is a piece of a larger one."""
        return self.partition.body(body.subdomain) != self.partition.names[body.subdomain]

    def interface(self, sides: tuple[int, int], nodes: tuple[np.ndarray, np.ndarray], triangles: np.ndarray, cells: np.ndarray,
                  **more: Any) -> Interface:
        """An interface of subdomains, of global nodes (n₁,) and (n₂,) on either side; all components count as free."""
        own = tuple(self.numbering.find(np.int64(e), ids) - self.numbering.offsets[e] for e, ids in zip(sides, nodes))
        return Interface(-1, " | ".join(self.names(sides)), sides, nodes[0], own, triangles, cells,
                         np.ones((len(nodes[0]), 3), dtype=bool), **more)


def side_nodes(numbering: SplitNumbering, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """Global nodes of both sides of an interface."""
    return tuple(numbering.nodes[numbering.offsets[e] + own] for e, own in zip(interface.subdomains, interface.nodes))
