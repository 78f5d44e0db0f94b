"""What a rank makes its part of a scene of: its subdomains, and cells of others around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.errors import Problems, wrong
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.scene.bolts import BoltCut
from orchestrator.scene.conditions.selection import assign_materials
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.mesh import Mesh, checked
from orchestrator.scene.mesh.quadratic import TET_EDGES, Choice, choose_element, edges_of, quadratic, stiffest
from orchestrator.scene.partition import PATH, Partition
from orchestrator.scene.pieces.share import Share


@dataclass(frozen=True)
class Extent:
    """Of a whole mesh.

    nodes : how many; box : (2, 3) around them
    """

    nodes: int
    box: np.ndarray


@dataclass(frozen=True)
class Piece:
    """Some subdomains of a mesh, and of others the cells that touch these, be it in a single node.

    mesh, faces : of these cells; of its outer faces those alone that are the whole mesh's, too
    partition : its subdomains, also those of which it has a few cells, see ``here``
    present : (subdomains,) int, ascending, which of the whole scene's these are; where bolts are cut twice that, and one more ahead of a cut
    count : how many that leaves room for
    number, cell_number : (n,) and (m,) int, ascending, the nodes' and the cells' numbers in the whole mesh
    cuts : of bolts of which some cells are here; cautions : what is said of them
    choice : of the element, where that was left open
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    present: np.ndarray
    number: np.ndarray
    cell_number: np.ndarray
    count: int
    cuts: Sequence[BoltCut] = ()
    cautions: Sequence[str] = ()
    choice: Choice | None = None

    @classmethod
    def of(cls, share: Share, outer: np.ndarray, mine: np.ndarray) -> Piece:
        """Of all cells at the nodes of some subdomains.

        outer : (k, 3) int, outer faces of the whole mesh
        mine : (s,) int, ascending, subdomains of the whole scene that are all here
        Raises InputError: one of them has no tets or is not connected; tets are inverted, ranks have read what does not agree
        """
        (mesh, faces), whole = checked(share.mesh), share.partition
        if mesh is not share.mesh or not share.sound:
            raise wrong(("mesh",), "tets that are inverted, or files that do not agree", "files of one sound mesh")
        kept = faces.neighbour >= 0
        kept[faces.find(outer)] = True
        faces = Faces(faces.nodes, *(x[kept] for x in (faces.triangles, faces.keys, faces.owner, faces.neighbour)), *2 * [np.empty(0, int)])
        present, subdomain = np.unique(whole.subdomain, return_inverse=True)
        owner = subdomain[np.unique(pieces(faces, subdomain)[1], return_index=True)[1]]
        if (np.bincount(owner, minlength=len(present))[np.isin(present, mine)] > 1).any() or not np.isin(mine, present).all():
            raise wrong(PATH, "subdomains that are empty or in pieces", "connected subdomains")
        cut = Partition(subdomain.ravel(), *([of[e] for e in present if of] for of in (whole.names, whole.bodies)), np.isin(present, mine))
        return cls(mesh, faces, cut, present, share.number, share.cell_number, len(whole.names))

    def of_element(self, element: str, matter: Sequence[Any], nodes: int, team: Team) -> tuple[Piece, int]:
        """The same, with a node in the middle of every edge of P2, or where ``auto`` chooses that, of a mesh of so many corners; and how
        many nodes it has then. All ranks ask together; ``matter`` of the configuration."""
        if element == "P1":
            return self, nodes
        ends, choice = edges_of(self.mesh.cells, TET_EDGES)[0], None
        middles, edges = numbered(self.number[ends] @ [nodes, 1], team)
        if element == "auto":
            choice = choose_element(3 * (nodes + edges), team.max(stiffest(*assign_materials(self.mesh, matter, Problems())))[0])
            if choice.element == "P1":
                return replace(self, choice=choice), nodes
        mesh, faces = quadratic(self.mesh, self.faces)
        return replace(self, mesh=mesh, faces=faces, number=np.concatenate([self.number, nodes + middles]), choice=choice), nodes + edges
