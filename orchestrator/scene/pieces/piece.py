"""What a rank makes its part of a scene of: its subdomains, and cells of others around them.

Cells of a mesh that ranks have in shares, and hand on to each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.errors import Problems, wrong
from orchestrator.parallel.numbering import numbered
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.selection import assign_materials
from orchestrator.scene.mesh.faces import Faces, LOCAL_FACES, pack, pieces
from orchestrator.scene.mesh.mesh import checked, Mesh
from orchestrator.scene.mesh.quadratic import (Choice, choose_element, edges_of, quadratic,
                                               stiffest, TET_EDGES)
from orchestrator.scene.partition import Partition, PATH


@dataclass(frozen=True)
class Share:
    """Some cells of a mesh with their nodes.

    mesh : of these; partition : of these; names of volumes, surfaces and subdomains are those of the whole mesh, in one order on all ranks
    number, cell_number : (n,) and (m,) int, ascending, the nodes' and the cells' numbers in the whole mesh
    sound : whether what ranks have told of one node or cell was the same
    """

    mesh: Mesh
    partition: Partition
    number: np.ndarray
    cell_number: np.ndarray
    sound: bool = True

    @property
    def without_cells(self) -> Share:
        """What is known of the whole mesh."""
        none = np.empty(0, dtype=int)
        return Share(self.mesh.hollow, replace(self.partition, subdomain=none), none, none)

    def handed_on(self, cells: Sequence[np.ndarray], team: Team) -> Share:
        """What all ranks hand on to this one; they do it together.

        cells : for every rank (k,) int, which of this rank's cells it gets; with them go their nodes, and named triangles on their faces
        """
        told = [self._rows(some) for some in cells]
        cell, node, face = (np.concatenate(team.deliver([rows[i] for rows in told])).reshape(-1, width)
                            for i, width in enumerate((3 + self.mesh.cells.shape[1], 4, 4 + 9 * bool(self.mesh.smooth))))
        cell, same = _each_once(cell)
        node, alike = _each_once(node)
        face, at = face[:, :4].astype(int), face[:, 4:]
        face, which = np.unique(face, axis=0, return_index=True)
        number, cell_rows = node[:, 0].astype(int), cell.astype(int)
        ends = np.searchsorted(face[:, 0], np.arange(1, len(self.mesh.surfaces)))
        triangles = np.split(np.searchsorted(number, face[:, 1:]), ends) if self.mesh.surfaces else []
        normals = dict(zip(self.mesh.surfaces, np.split(at[which].reshape(len(which), at.shape[1] // 3, 3), ends)))
        mesh = replace(self.mesh, nodes=np.ascontiguousarray(node[:, 1:]), cells=np.searchsorted(number, cell_rows[:, 3:]),
                       volume=cell_rows[:, 1].copy(), surfaces=dict(zip(self.mesh.surfaces, triangles)),
                       smooth={name: shape if shape.normals is None else replace(shape, normals=normals[name])
                               for name, shape in self.mesh.smooth.items()})
        return Share(mesh, replace(self.partition, subdomain=cell_rows[:, 2].copy()), number, cell_rows[:, 0].copy(), self.sound and same and alike)

    def _rows(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Numbers of some cells (k, 3 + corners) with their volumes, subdomains and nodes, of nodes (n, 4) with their places, and of triangles
        (t, 4) with the surface that names them, (t, 13) with normals at their corners where a CAD model tells of shapes."""
        mesh, own = self.mesh, self.mesh.cells[cells]
        nodes = np.unique(own)
        named = np.concatenate([np.empty((0, 3), dtype=int), *mesh.surfaces.values()])
        surface = np.repeat(np.arange(len(mesh.surfaces)), [len(triangles) for triangles in mesh.surfaces.values()])
        on = np.zeros(len(mesh.nodes), dtype=bool)
        on[named] = True
        beside = own[on[own].sum(axis=1) > 2]  # a few of all: the others have no face that is named
        keys = np.concatenate([pack(beside[:, face], len(mesh.nodes)) for face in LOCAL_FACES])
        there = np.isin(pack(named, len(mesh.nodes)), keys)
        known = {name: shape.normals.reshape(-1, 9) for name, shape in mesh.smooth.items() if shape.normals is not None}
        width = 9 * bool(mesh.smooth)
        normals = np.concatenate([np.empty((0, width)), *(known.get(name, np.full((len(triangles), width), np.nan))
                                                          for name, triangles in mesh.surfaces.items())])
        return (np.column_stack([self.cell_number[cells], mesh.volume[cells], self.partition.subdomain[cells], self.number[own]]),
                np.column_stack([self.number[nodes], mesh.nodes[nodes]]),
                np.column_stack([surface[there], self.number[named[there]], normals[there]]))


def _each_once(rows: np.ndarray) -> tuple[np.ndarray, bool]:
    """Rows by their first numbers, ascending, each once; and whether those of one number are the same."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    again = np.flatnonzero(rows[1:, 0] == rows[:-1, 0])
    return np.delete(rows, again + 1, axis=0), bool((rows[again + 1] == rows[again]).all())


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
    present : (subdomains,) int, ascending, which of the whole scene's these are
    count : how many the whole scene has
    number, cell_number : (n,) and (m,) int, ascending, the nodes' and the cells' numbers in the whole mesh
    choice : of the element, where that was left open
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    present: np.ndarray
    number: np.ndarray
    cell_number: np.ndarray
    count: int
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
