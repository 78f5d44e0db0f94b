"""Stress at the nodes: of each part and each matter by itself, never averaged across.

The stresses of the tets around a node, there, are averaged by volume. A node has one such stress for each part and each
matter that it belongs to, and for each side of an interface that may open or whose meshes do not match; perfect interfaces
inside a part leave no trace. In between, and in the middle of edges, it is linear.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from orchestrator.scene.mesh.mesh import split_numbering
from orchestrator.scene.elasticity import von_mises


class Nodal:
    """Nodal stresses of a solution; K nodes, counted once for each stress that they have.

    Made of ``Fields``, which keep it.

    fields : those on ``Fields.opened``, whose nodes are meant
    corner : (m, 4) int, which of the K each tet's corners are
    node : (K,) int, one of the nodes of ``fields`` at each; where copies have been joined, the first
    part : (K,) int, index into ``Fields.parts``
    """

    def __init__(self, fields: Any):
        self.fields = fields.opened
        corners = self.fields.cells[:, :4]
        joined = corners if fields.joined is None else fields.joined[corners]
        kind = self.fields.material
        if fields.part is not None and len(fields.parts) > 1:
            kind = kind + np.int64(kind.max() + 1) * fields.part
        kinds = np.unique(kind, return_inverse=True)[1].ravel() if kind.any() else kind
        split = split_numbering(joined, kinds, int(joined.max()) + 1)
        self.corner, self.node = split.corners, split.nodes
        if fields.joined is not None:
            self.node = np.empty(len(split.nodes), dtype=int)
            self.node[self.corner[::-1]] = corners[::-1]  # the first one stays
        self.part = np.zeros(len(self.node), dtype=int)
        if fields.part is not None:
            self.part[self.corner] = fields.part[:, None]
        self._latest = -1, np.empty((0, 6))  # load step and its stress

    @cached_property
    def _around(self) -> np.ndarray:
        """(K,) volume around each; formed at the first stress: who only numbers nodes needs none."""
        return np.bincount(self.corner.ravel(), np.repeat(self.fields.volumes, 4), minlength=len(self))

    def __len__(self) -> int:
        return len(self.node)

    @property
    def points(self) -> np.ndarray:
        """(K, 3) where the nodes are."""
        return self.fields.nodes[self.node]

    def stress(self, step: int) -> np.ndarray:
        """(K, 6) stress at one load step, in VTK's order; nan where it is not to be believed."""
        if self._latest[0] == step:
            return self._latest[1]
        fields, volumes = self.fields, self.fields.volumes
        linear = fields.cells.shape[1] == 4
        sigma = fields.stress(step) if linear else fields.corner_stress(step)
        result = np.empty((6, len(self)))
        for c in range(6):
            each = np.repeat(volumes * sigma[:, c], 4) if linear else (volumes[:, None] * sigma[:, :, c]).ravel()
            result[c] = np.bincount(self.corner.ravel(), each, minlength=len(self))
        if fields.believed is not None:
            result[:, self.corner[~fields.believed]] = np.nan
        result /= self._around
        self._latest = step, result.T
        return self._latest[1]

    def von_mises(self, step: int) -> np.ndarray:
        """(K + e,) von Mises stress at the places of ``split``."""
        return von_mises(self.everywhere(self.stress(step)))

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """(e, 2) int, of the nodes in the middle of edges of ten-node tets, which of the K are the ends; (m, 6) int, edges of each tet."""
        from orchestrator.scene.mesh.quadratic import TET_EDGES, edges_of

        return edges_of(self.corner, TET_EDGES)

    @cached_property
    def split(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of ``fields`` (K + e,) at each place that has a stress, edges' middles last, and the tets (m, 4 or 10) on them."""
        if self.fields.cells.shape[1] == 4:
            return self.node, self.corner
        ends, edge = self._edges
        middle = np.zeros(len(ends), dtype=int)
        middle[edge] = self.fields.cells[:, 4:]
        return np.concatenate([self.node, middle]), np.hstack([self.corner, len(self) + edge])

    def everywhere(self, values: np.ndarray) -> np.ndarray:
        """(K + e, …) values (K, …) of the nodes, and in the middle of edges the mean of their ends."""
        return values if self.fields.cells.shape[1] == 4 else np.concatenate([values, values[self._edges[0]].mean(axis=1)])
