"""Generated boxes and beams by their blocks: of a rank's subdomains the bricks, and one layer of bricks around."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from orchestrator.parallel.team import Team
from orchestrator.scene.mesh.bricks import TETS
from orchestrator.scene.mesh.sources import grid_of
from orchestrator.scene.partition import AXES, block_name, layers, slice_name
from orchestrator.scene.pieces.piece import Extent, Piece
from orchestrator.scene.pieces.pushed import cells_at_tools
from orchestrator.scene.pieces.share import Share

ROUNDING = 1e-6  # of a brick, what its tets' centroids may be off; bricks more than are needed do no harm


class Boxes:
    """A box of bricks that is cut into equal blocks.

    mesh : ``mesh`` of the configuration; blocks : (3,) int along x, y, z; sliced : the axis along which these are slices, −1 for none
    """

    def __init__(self, mesh: Any, blocks: np.ndarray, sliced: int = -1):
        self._bricks, self._blocks, self._sliced = grid_of(mesh), blocks, sliced
        self._factor, self._beside = float(mesh.scale or 1.0), np.empty(0, dtype=int)

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
    def extent(self) -> Extent:
        """Of the whole mesh."""
        return Extent(int(np.prod(self._bricks.counts + 1)), self._factor * np.stack([np.zeros(3), self._bricks.size]))

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

    def deal(self, rank_of: np.ndarray, entries: Sequence[Any], tools: Sequence[Any], team: Team) -> None:
        """Nothing but bricks elsewhere that some of the ``tools`` that are pushed may touch, too: every rank makes its own."""
        if tools:
            share, block = self._share(np.flatnonzero(rank_of == team.rank))
            at = cells_at_tools(share.mesh, rank_of[block] == team.rank, np.concatenate([*share.mesh.surfaces.values()]), tools, team)
            self._beside = np.unique(np.concatenate(team.deliver([share.cell_number[cells] // TETS for cells in at]))).astype(int)

    def piece(self, mine: np.ndarray) -> Piece:
        """Of some subdomains, ascending.

        Raises InputError: one of them has no tets or is not connected
        """
        share, block = self._share(mine)
        return Piece.of(share, np.concatenate([*share.mesh.surfaces.values()]), block, mine, self)

    def _share(self, mine: np.ndarray) -> tuple[Share, np.ndarray]:
        """Some blocks, and what is around them; (m,) int, the block of each tet."""
        mesh, *numbers = self._bricks.some(np.unique(np.concatenate([self._beside, *self._around(mine)])))
        mesh = replace(mesh, nodes=self._factor * mesh.nodes, within=self.extent.box)
        block = np.ravel_multi_index([layers(mesh, axis, int(count)) for axis, count in enumerate(self._blocks)], self._blocks)
        return Share(mesh, *numbers), block

    def _around(self, mine: np.ndarray) -> Iterator[np.ndarray]:
        """Bricks of each of some blocks, and one layer around: a block has those with a tet whose centroid is in it, at 1/4 to 3/4."""
        counts = self._bricks.counts
        for place in np.stack(np.unravel_index(mine, self._blocks), axis=1):
            low, high = (counts * (place + end) / self._blocks for end in (0, 1))
            first = np.maximum(np.ceil(low - 0.75 - ROUNDING).astype(int) - 1, 0)
            last = np.minimum(np.floor(high - 0.25 + ROUNDING).astype(int) + 1, counts - 1)
            yield np.ravel_multi_index(np.ix_(*(np.arange(a, b + 1) for a, b in zip(first, last))), counts).ravel()
