"""Parts that all grains of a tessellation share: vertices, edges divided into elements, faces;
which
grains are at each, and numbers for their nodes.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from orchestrator.scene.mesh.faces import MAX_NODES
from orchestrator.scene.mesh.grains.polyhedra import Tessellation

# Edges have pieces of h at most, but for this share of it.
OVER = 0.01
# The tag of a node is that of its vertex, edge, face or grain times this, and its place there;
# messages hold it exactly.
EACH = MAX_NODES + 1


class Skeleton:
    """A tessellation as something to mesh with elements of size h; how an edge is divided depends
    on that edge alone.

    Vertices, edges, faces and grains, in this order, are its entities.

    cells : faces must be plane
    grains : how many
    faces_of : per grain its faces
    """

    def __init__(self, cells: Tessellation, h: float):
        self.cells, self.h, self.grains = cells, h, int(cells.cells.max()) + 1
        ends = [sorted(end) for loop in cells.loops for end in zip(loop, [*loop[1:], loop[0]])]
        self._ends, edge = np.unique(np.array(ends), axis=0, return_inverse=True)
        self._edges = edges = np.split(edge.ravel(),
                                       np.cumsum([len(loop) for loop in cells.loops])[:-1])
        low, high = cells.vertices[self._ends].transpose(1, 0, 2)
        self._pieces = np.maximum(np.ceil(np.linalg.norm(high - low, axis=1) / h - OVER),
                                  1).astype(int)
        inner = self._pieces - 1
        on, self._inner = np.repeat(np.arange(len(inner)), inner), np.cumsum([0, *inner])
        place = np.arange(len(on)) - self._inner[on]
        self._tags = (len(cells.vertices) + on) * EACH + place
        self._points = low[on] + ((place + 1) / self._pieces[on])[:, None] * (high - low)[on]
        # entities of each kind
        self._first = np.cumsum([0, len(cells.vertices), len(self._ends), len(cells.loops)])
        self.faces_of: list[list[int]] = [[] for _ in range(self.grains)]
        self._around: list[set[int]] = [set() for _ in range(self._first[3])] + [
            {grain} for grain in range(self.grains)]
        for face, (loop, own) in enumerate(zip(cells.loops, cells.cells.tolist())):
            for grain in own[: 1 + (own[1] >= 0)]:
                self.faces_of[grain].append(face)
                for entity in (*loop, *(self._first[1] + edges[face]), self._first[2] + face):
                    self._around[entity].add(grain)

    def outline(self, face: int) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int, int]]]:
        """Tags (n,) and points (n, 3) of the nodes around a face: its corners in order, then those
        on each edge; and of each edge the place
        of its lower vertex among the corners, of its higher one, and its number of pieces."""
        loop, edges = self.cells.loops[face], self._edges[face]
        on = np.concatenate([np.arange(self._inner[edge], self._inner[edge + 1]) for edge in edges])
        lines = [(loop.index(low), loop.index(high), pieces)
                 for (low, high), pieces in zip(self._ends[edges].tolist(),
                                                self._pieces[edges].tolist())]
        return np.concatenate([np.array(loop) * EACH, self._tags[on]]), np.concatenate(
            [self.cells.vertices[loop], self._points[on]]), lines

    def in_face(self, face: int, count: int) -> np.ndarray:
        """(count,) tags of the nodes within a face."""
        return (self._first[2] + face) * EACH + np.arange(count)

    def in_grain(self, grain: int, count: int) -> np.ndarray:
        """(count,) tags of the nodes within a grain, or of its cells."""
        return (self._first[3] + grain) * EACH + np.arange(count)

    def grains_at(self, tags: np.ndarray) -> set[int]:
        """All grains at nodes."""
        return set().union(*(self._around[entity] for entity in np.unique(tags // EACH)))

    def all_at(self, tags: np.ndarray, grains: Iterable[int]) -> np.ndarray:
        """(n,) bool, whether all grains at a node are among some."""
        entities, which = np.unique(tags // EACH, return_inverse=True)
        grains = set(grains)
        return np.array([self._around[entity] <= grains for entity in entities])[which.ravel()]
