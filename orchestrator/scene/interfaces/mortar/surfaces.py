"""Two surfaces that face each other, each with its own facets, and how these overlap."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orchestrator.scene.interfaces.mortar.segments import Segments
from orchestrator.scene.mesh.geometry import area_vectors


@dataclass(frozen=True)
class Surfaces:
    """The facets of either side that overlap the other, and their nodes; the slave first.

    points : (n₁, 3), (n₂, 3) where the nodes are
    nodes : (n₁,), (n₂,) int, their global ids, ascending
    triangles : (k₁, 3 or 6), (k₂, 3 or 6) int, indices into them, outward of the own body
    cells : (k₁,), (k₂,) int, global cells behind the facets
    segments : the overlaps, in these numbers of facets
    resting : (k₁,) area of the slave's facets before they have been moved to where they are; None: it is what it is here
    """

    points: tuple[np.ndarray, np.ndarray]
    nodes: tuple[np.ndarray, np.ndarray]
    triangles: tuple[np.ndarray, np.ndarray]
    cells: tuple[np.ndarray, np.ndarray]
    segments: Segments
    resting: np.ndarray | None = None

    @classmethod
    def of(cls, points: np.ndarray, triangles: tuple[np.ndarray, np.ndarray], cells: tuple[np.ndarray, np.ndarray],
           segments: Segments, more: tuple[np.ndarray, np.ndarray] | None = None) -> Surfaces:
        """Of the facets that overlap some other, and no more but for those that are asked for.

        points : (n, 3) all nodes; triangles : global ids of the nodes of the facets of either side; cells : behind them
        segments : in the numbers of these facets
        more : facets of either side that are wanted whether they overlap some other or not
        """
        met = [np.unique(side) for side in (segments.slave, segments.master)]
        if more is not None:
            met = [np.union1d(*both) for both in zip(met, more)]
        place = [np.zeros(len(t), dtype=int) for t in triangles]
        for number, own in zip(place, met):
            number[own] = np.arange(len(own))
        nodes, local = zip(*(np.unique(t[own], return_inverse=True) for t, own in zip(triangles, met)))
        return cls(tuple(points[n] for n in nodes), nodes, tuple(at.reshape(-1, t.shape[1]) for at, t in zip(local, triangles)),
                   tuple(c[own] for c, own in zip(cells, met)), segments.numbered(*place))

    def moved(self, points: np.ndarray) -> Surfaces:
        """The same facets where their nodes (n, 3) are now; the overlaps stay what they were."""
        return replace(self, points=tuple(points[n] for n in self.nodes))

    def turned(self) -> Surfaces:
        """What the sides are once slave and master have changed places, without overlaps."""
        none = self.segments.some(np.empty(0, int))
        return Surfaces(*(pair[::-1] for pair in (self.points, self.nodes, self.triangles, self.cells)), none)

    @property
    def overlapping(self) -> tuple[np.ndarray, np.ndarray]:
        """Global ids of the nodes of either side whose facets overlap the other side's."""
        return tuple(np.unique(nodes[t[own]]) for nodes, t, own in zip(
            self.nodes, self.triangles, (self.segments.slave, self.segments.master)))

    @property
    def area(self) -> np.ndarray:
        """(k₁,) of the slave's facets."""
        if self.resting is not None:
            return self.resting
        return np.linalg.norm(area_vectors(self.points[0], self.triangles[0]), axis=1)

    @property
    def behind(self) -> tuple[np.ndarray, np.ndarray]:
        """(k₁, 2), (k₂, 2) global cells behind each facet of either side: the slave's and the master's, of those opposite
        the one that overlaps it most."""
        found = []
        for side, other in ((0, 1), (1, 0)):
            own, opposite = (getattr(self.segments, name) for name in ("slave", "master")[:: 1 - 2 * side])
            order = np.lexsort((opposite, -self.segments.area, own))
            first = order[np.unique(own[order], return_index=True)[1]]
            some = opposite[first[0]] if len(first) else 0  # where nothing is opposite
            across = np.full(len(self.cells[side]), self.cells[other][some])
            across[own[first]] = self.cells[other][opposite[first]]
            found.append(np.stack((self.cells[side], across)[:: 1 - 2 * side], axis=1))
        return tuple(found)
