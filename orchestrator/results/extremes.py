"""The largest and smallest of every quantity, part by part, with their places and load steps;
signed.

extremes.csv has a line for each: displacement of the nodes, stress as in ``nodal``.

Stress at the nodes: of each part and each matter by itself, never averaged across.

The stresses of the tets around a node, there, are averaged by volume. A node has one such stress
for each part and each matter that it belongs to, and for each side of an interface that may open or
whose meshes do not match; perfect interfaces inside a part leave no trace. In between, and in the
middle of edges, it is linear.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np

from orchestrator.scene.elasticity import principal, von_mises
from orchestrator.scene.mesh.mesh import split_numbering


class Nodal:
    """Nodal stresses of a solution; K nodes, counted once for each stress that they have.

    Made of ``Fields``, which keep it.

    fields : those on ``Fields.opened``, whose nodes are meant
    corner : (m, 4) int, which of the K each tet's corners are
    node : (K,) int, one of the nodes of ``fields`` at each; where copies have been joined, the
        first
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
        self.corner = split.corners
        self.node, self.part = np.zeros((2, len(split.nodes)), int)
        self.node[self.corner[::-1]] = corners[::-1]  # the first one stays
        if fields.part is not None:
            self.part[self.corner] = fields.part[:, None]
        self._latest = -1, np.empty((0, 6))  # load step and its stress

    @cached_property
    def _around(self) -> np.ndarray:
        """(K,) volume around each; formed at the first stress: who only numbers nodes needs
        none.
        """
        return np.bincount(self.corner.ravel(), np.repeat(self.fields.volumes, 4),
                           minlength=len(self))

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
        fields, sigma, where = self.fields, self.fields.corner_stress(step), self.corner.ravel()
        result = np.stack([np.bincount(where, (fields.volumes[:, None] * sigma[:, :, c]).ravel(),
                                       len(self)) for c in range(6)])
        if fields.believed is not None:
            result[:, self.corner[~fields.believed]] = np.nan
        result /= self._around
        self._latest = step, result.T
        return result.T

    def von_mises(self, step: int) -> np.ndarray:
        """(K + e,) von Mises stress at the places of ``split``."""
        return von_mises(self.everywhere(self.stress(step)))

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """(e, 2) int, of the nodes in the middle of edges of ten-node tets, which of the K are the
        ends; (m, 6) int, edges of each tet.
        """
        from orchestrator.scene.mesh.quadratic import TET_EDGES, edges_of

        return edges_of(self.corner, TET_EDGES)

    @cached_property
    def split(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of ``fields`` (K + e,) at each place that has a stress, edges' middles last, and
        the tets (m, 4 or 10) on them.
        """
        if self.fields.cells.shape[1] == 4:
            return self.node, self.corner
        ends, edge = self._edges
        middle = np.zeros(len(ends), int)
        middle[edge] = self.fields.cells[:, 4:]
        return np.concatenate([self.node, middle]), np.hstack([self.corner, len(self) + edge])

    def everywhere(self, values: np.ndarray) -> np.ndarray:
        """(K + e, …) values (K, …) of the nodes, and in the middle of edges the mean of their
        ends.
        """
        return values if self.fields.cells.shape[1] == 4 else np.concatenate(
            [values, values[self._edges[0]].mean(axis=1)])


NAME = "extremes.csv"
DISPLACEMENT = ("ux", "uy", "uz", "|u|")
STRESS = ("sxx", "syy", "szz", "sxy", "syz", "sxz", "von_mises", "s1", "s2", "s3")
QUANTITIES = DISPLACEMENT + STRESS
ENDS = ("min", "max")
RESULTANT = ("fx", "fy", "fz", "mx", "my", "mz")
COLUMNS = ("part", "quantity", "extreme", "value", "x", "y", "z", "load_step")


def components_of_stress(sigma: np.ndarray) -> np.ndarray:
    """(..., 10) as ``STRESS``, of stresses (..., 6) in VTK's order."""
    return np.concatenate([sigma, von_mises(sigma)[..., None], principal(sigma)], axis=-1)


def components_of_displacement(u: np.ndarray) -> np.ndarray:
    """(..., 4) components and length of displacements (..., 3), as ``DISPLACEMENT``."""
    return np.concatenate([u, np.linalg.norm(u, axis=-1, keepdims=True)], axis=-1)


def extremes(nodal: Nodal, lost: np.ndarray | None = None) -> list[tuple]:
    """Return the smallest and the largest of each quantity of each part, over all load steps: rows
    with ``COLUMNS``. What is not known is left out.

    lost : (steps, subdomains) bool, bodies that nothing holds: where they are means nothing; None:
        there are none
    """
    fields, names = nodal.fields, nodal.fields.parts or ("",)
    node, cells = nodal.split
    part = np.zeros(len(node), int)
    part[cells] = 0 if fields.part is None else fields.part[:, None]
    shape = (2, len(names), len(QUANTITIES))
    value, step_of, at = np.full(shape, np.nan), np.zeros(shape, int), np.zeros((*shape, 3))
    for step in range(fields.steps):
        u = components_of_displacement(fields.displacement[step][node])
        if lost is not None and lost[step].any():
            u[np.unique(cells[lost[step][fields.subdomain]])] = np.nan
        moved = _ends(u, part, len(names))
        inside = _ends(components_of_stress(nodal.stress(step)), nodal.part, len(names))
        found, which = (np.concatenate(both, axis=2) for both in zip(moved, inside))
        better = np.stack([~(found[0] >= value[0]), ~(found[1] <= value[1])]) & np.isfinite(found)
        value[better], step_of[better] = found[better], step + 1
        at[better] = fields.nodes[node][which[better]]
    return [(names[p], QUANTITIES[q], ENDS[k], float(value[k, p, q]), *at[k, p, q].tolist(),
             int(step_of[k, p, q]))
            for p, q, k in np.argwhere(np.isfinite(np.moveaxis(value, 0, -1)))]


def peak(rows: Iterable[tuple], quantity: str) -> dict[str, object] | None:
    """Return the largest of all parts: value, at, part, load_step; None where none is known."""
    own = [row for row in rows if row[1:3] == (quantity, ENDS[1])]
    if not own:
        return None
    part, _, _, value, *at, step = max(own, key=lambda row: row[3])
    return {"value": value, "at": at, "part": part, "load_step": step}


def _ends(values: np.ndarray, part: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(2, count, q) smallest and largest of values (K, q) of each part, and where these are, int;
    nan where all are nan.
    """
    result = np.full((2, count, values.shape[1]), np.nan)
    which = np.zeros(result.shape, int)
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    known = known[np.argsort(part[known], kind="stable")]
    bounds = np.searchsorted(part[known], np.arange(count + 1))
    for p, rows in enumerate(np.split(known, bounds[1:-1])):
        if len(rows):
            places = np.stack([values[rows].argmin(axis=0), values[rows].argmax(axis=0)])
            which[:, p] = rows[places]
            result[:, p] = np.take_along_axis(values, which[:, p], axis=0)
    return result, which
