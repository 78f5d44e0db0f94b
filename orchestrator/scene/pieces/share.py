"""Cells of a mesh that ranks have in shares, and hand on to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.faces import LOCAL_FACES, pack
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.partition import Partition


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
