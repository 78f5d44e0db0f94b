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

from collections.abc import Iterator
from dataclasses import dataclass
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
        fields, volumes = self.fields, self.fields.volumes
        linear = fields.cells.shape[1] == 4
        sigma = fields.stress(step) if linear else fields.corner_stress(step)
        result = np.empty((6, len(self)))
        for c in range(6):
            each = np.repeat(volumes * sigma[:, c],
                             4) if linear else (volumes[:, None] * sigma[:, :, c]).ravel()
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
        middle = np.zeros(len(ends), dtype=int)
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
RESULTANT = ("fx", "fy", "fz", "mx", "my", "mz")
COLUMNS = ("part", "quantity", "extreme", "value", "x", "y", "z", "load_step")


@dataclass(frozen=True)
class Extremes:
    """Extremes of p parts and q quantities, as ``DISPLACEMENT`` and ``STRESS`` name them, the
    smallest and the largest.

    parts : names; quantities : names
    value : (2, p, q), nan where nothing is known or to be believed
    at : (2, p, q, 3) places in the undeformed body; step : (2, p, q) int, from 1
    """

    parts: tuple[str, ...]
    quantities: tuple[str, ...]
    value: np.ndarray
    at: np.ndarray
    step: np.ndarray

    @property
    def rows(self) -> Iterator[tuple]:
        """Rows with ``COLUMNS``; what is not known is left out."""
        for p, part in enumerate(self.parts):
            for q, quantity in enumerate(self.quantities):
                for k, extreme in enumerate(("min", "max")):
                    if np.isfinite(self.value[k, p, q]):
                        yield (part, quantity, extreme, float(self.value[k, p, q]),
                               *map(float, self.at[k, p, q]), int(self.step[k, p, q]))

    def largest(self, quantity: str) -> dict[str, object] | None:
        """The largest of all parts: value, at, part, load_step; None where none is known."""
        values = self.value[1, :, self.quantities.index(quantity)]
        if not np.isfinite(values).any():
            return None
        p, q = int(np.nanargmax(values)), self.quantities.index(quantity)
        return {"value": float(values[p]), "at": self.at[1, p, q].tolist(), "part": self.parts[p],
                "load_step": int(self.step[1, p, q])}


def components_of_stress(sigma: np.ndarray) -> np.ndarray:
    """(..., 10) as ``STRESS``, of stresses (..., 6) in VTK's order."""
    return np.concatenate([sigma, von_mises(sigma)[..., None], principal(sigma)], axis=-1)


def components_of_displacement(u: np.ndarray) -> np.ndarray:
    """(..., 4) components and length of displacements (..., 3), as ``DISPLACEMENT``."""
    return np.concatenate([u, np.linalg.norm(u, axis=-1, keepdims=True)], axis=-1)


def extremes(nodal: Nodal, lost: np.ndarray | None = None) -> Extremes:
    """Extremes of a solution, over all load steps.

    lost : (steps, subdomains) bool, bodies that nothing holds: where they are means nothing; None:
        there are none
    """
    fields, names = nodal.fields, nodal.fields.parts or ("",)
    node, cells = nodal.split
    part = np.zeros(len(node), dtype=int)
    part[cells] = 0 if fields.part is None else fields.part[:, None]
    points = fields.nodes[node]
    shape = (2, len(names), len(DISPLACEMENT) + len(STRESS))
    value, step_of, at = np.full(shape, np.nan), np.zeros(shape, dtype=int), np.zeros((*shape, 3))
    for step in range(fields.steps):
        u = components_of_displacement(fields.displacement[step][node])
        if lost is not None and lost[step].any():
            u[np.unique(cells[lost[step][fields.subdomain]])] = np.nan
        moved = _ends(u, part, len(names))
        inside = _ends(components_of_stress(nodal.stress(step)), nodal.part, len(names))
        found, which = (np.concatenate(both, axis=2) for both in zip(moved, inside))
        better = np.stack([~(found[0] >= value[0]), ~(found[1] <= value[1])]) & np.isfinite(found)
        value[better], step_of[better] = found[better], step + 1
        at[better] = points[which[better]]
    return Extremes(names, DISPLACEMENT + STRESS, value, at, step_of)


def _ends(values: np.ndarray, part: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(2, count, q) smallest and largest of values (K, q) of each part, and where these are, int;
    nan where all are nan.
    """
    order = np.argsort(part, kind="stable") if count > 1 else np.arange(len(part))
    bounds = np.searchsorted(part[order], np.arange(count + 1))
    result, which = np.full((2, count, values.shape[1]),
                            np.nan), np.zeros((2, count, values.shape[1]), dtype=int)
    for p, (a, b) in enumerate(zip(bounds[:-1], bounds[1:])):
        rows = order[a:b]
        rows = rows[np.isfinite(values[rows]).all(axis=1)]
        if len(rows):
            own = values[rows]
            for k, place in enumerate((own.argmin(axis=0), own.argmax(axis=0))):
                which[k, p] = rows[place]
                result[k, p] = own[place, np.arange(own.shape[1])]
    return result, which
