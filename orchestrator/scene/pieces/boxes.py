"""Generated boxes and beams by their blocks: of a rank's subdomains the bricks, and one layer of bricks around."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from orchestrator.errors import wrong
from orchestrator.scene.mesh.faces import Faces, pieces
from orchestrator.scene.mesh.mesh import Mesh, checked
from orchestrator.scene.mesh.sources import grid_of
from orchestrator.scene.partition import AXES, PATH, Partition, block_name, layers, slice_name

ROUNDING = 1e-6  # of a brick, what its tets' centroids may be off; bricks more than are needed do no harm


@dataclass(frozen=True)
class Piece:
    """Some subdomains of a mesh, and of others the cells that touch these, be it in a single node.

    mesh, faces : of these cells; of its outer faces those alone that are the whole mesh's, too
    partition : its subdomains, also those of which it has a few cells
    present : (subdomains,) int, ascending, which of the whole scene's these are
    number, cell_number : (n,) and (m,) int, ascending, the nodes' and the cells' numbers in the whole mesh
    """

    mesh: Mesh
    faces: Faces
    partition: Partition
    present: np.ndarray
    number: np.ndarray
    cell_number: np.ndarray


class Boxes:
    """A box of bricks that is cut into equal blocks.

    mesh : ``mesh`` of the configuration; blocks : (3,) int along x, y, z; sliced : the axis along which these are slices, −1 for none
    """

    def __init__(self, mesh: Any, blocks: np.ndarray, sliced: int = -1):
        self._bricks, self._blocks, self._sliced = grid_of(mesh), blocks, sliced
        self._factor = float(mesh.scale or 1.0)

    @classmethod
    def of(cls, mesh: Any, subdomains: Any) -> Boxes | None:
        """Of the configuration's ``mesh`` and ``subdomains``; None where these are others."""
        if mesh is None or mesh.box is None and mesh.beam is None:
            return None
        if subdomains.grid is not None:
            return cls(mesh, np.array(subdomains.grid, dtype=int))
        if subdomains.slices is None:
            return None
        axis = AXES.index(subdomains.slices.axis)
        return cls(mesh, np.where(np.arange(3) == axis, int(subdomains.slices.count), 1), axis)

    @property
    def count(self) -> int:
        """Number of subdomains."""
        return int(np.prod(self._blocks))

    @property
    def box(self) -> np.ndarray:
        """(2, 3) the box around the whole mesh."""
        return self._factor * np.stack([np.zeros(3), self._bricks.size])

    @property
    def nodes(self) -> int:
        """Of the whole mesh."""
        return int(np.prod(self._bricks.counts + 1))

    def sizes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(subdomains,) nodes of each, but for those that tets of a brick between two blocks add; (k, 2) int, pairs that meet in faces;
        (k,) nodes that they share."""
        ends = [np.rint(count * np.arange(blocks + 1) / blocks).astype(int) for count, blocks in zip(self._bricks.counts, self._blocks)]
        along = np.stack(np.meshgrid(*(np.diff(e) + 1 for e in ends), indexing="ij"))
        number, pairs, common = np.arange(self.count).reshape(self._blocks), [], []
        for axis in range(3):
            low, high = (np.take(number, range(a, self._blocks[axis] - 1 + a), axis).ravel() for a in (0, 1))
            pairs.append(np.column_stack([low, high]))
            common.append(np.delete(along, axis, axis=0).prod(axis=0).ravel()[low])
        return along.prod(axis=0).ravel(), np.concatenate(pairs), np.concatenate(common)

    def name(self, index: int) -> str:
        """Of a subdomain."""
        place = [int(i) for i in np.unravel_index(index, self._blocks)]
        return block_name(*place) if self._sliced < 0 else slice_name(place[self._sliced])

    def piece(self, mine: np.ndarray) -> Piece:
        """Of some subdomains, ascending.

        Raises InputError: one of them has no tets or is not connected
        """
        mesh, number, cells = self._bricks.some(np.unique(np.concatenate([np.empty(0, int), *self._around(mine)])))
        mesh = replace(mesh, nodes=self._factor * mesh.nodes, within=self.box)
        mesh, faces = checked(mesh)
        kept = faces.neighbour >= 0
        kept[faces.outer] = self._bricks.on_sides(number, faces.triangles[faces.outer])
        faces = Faces(faces.nodes, *(x[kept] for x in (faces.triangles, faces.keys, faces.owner, faces.neighbour)), *2 * [np.empty(0, int)])
        block = np.ravel_multi_index([layers(mesh, axis, int(count)) for axis, count in enumerate(self._blocks)], self._blocks)
        present, subdomain = np.unique(block, return_inverse=True)
        owner = subdomain[np.unique(pieces(faces, subdomain)[1], return_index=True)[1]]
        if (np.bincount(owner, minlength=len(present))[np.isin(present, mine)] > 1).any() or not np.isin(mine, present).all():
            raise wrong(PATH, "subdomains that are empty or in pieces", "connected subdomains")
        return Piece(mesh, faces, Partition(subdomain.ravel(), [self.name(e) for e in present]), present, number, cells)

    def _around(self, mine: np.ndarray) -> Iterator[np.ndarray]:
        """Bricks of each of some blocks, and one layer around: a block has those with a tet whose centroid is in it, at 1/4 to 3/4."""
        counts = self._bricks.counts
        for place in np.stack(np.unravel_index(mine, self._blocks), axis=1):
            low, high = (counts * (place + end) / self._blocks for end in (0, 1))
            first = np.maximum(np.ceil(low - 0.75 - ROUNDING).astype(int) - 1, 0)
            last = np.minimum(np.floor(high - 0.25 + ROUNDING).astype(int) + 1, counts - 1)
            yield np.ravel_multi_index(np.ix_(*(np.arange(a, b + 1) for a, b in zip(first, last))), counts).ravel()
