"""Grains that can be meshed: a tessellation without short edges and tiny interfaces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from orchestrator.scene.mesh.polyhedra import Tessellation, area_vector, cut, narrowest, without_repeats

# Edges are removed below 2.2 h, so that they have two elements, but never above a fifth of a grain's size,
# where grains lose their shape.
SHORT_H, SHORT_GRAIN = 2.2, 0.2
# An interface needs 6 nodes for the 12 affine modes of traction and more; edges up to this share of a
# grain's size go for it.
FEW_NODES, LONG_GRAIN = 6, 0.5
# No merger may make an angle smaller than this, in radians (10 degrees; 5 where a tiny interface is at stake).
NARROW, NARROWEST = np.pi / 18, np.pi / 36


class Grains:
    """The faces of a tessellation while vertices are merged.

    cells : what to start from
    points, sides : (v, 3) and (v, 6) as in the tessellation; merged vertices keep their place
    loops : face → its vertices; faces that have vanished are gone
    cells : face → its two cells
    triangles : face → its triangles
    sound : whether all grains are bodies that fill the box
    """

    def __init__(self, cells: Tessellation):
        self.points, self.sides = cells.vertices.copy(), cells.sides.copy()
        self.loops = dict(enumerate(cells.loops))
        self.cells = {face: (int(a), int(b)) for face, (a, b) in enumerate(cells.cells)}
        self.triangles = dict(zip(self.loops, cut(self.points, list(self.loops.values()))))
        self.faces_at: dict[int, set[int]] = {}
        self.faces_of: dict[int, set[int]] = {}
        for face, loop in self.loops.items():
            for vertex in loop:
                self.faces_at.setdefault(vertex, set()).add(face)
            for cell in self.cells[face]:
                self.faces_of.setdefault(cell, set()).add(face)
        self._narrow = self._narrowest({cell for cell in self.faces_of if cell >= 0}, {}) or {}
        self.sound = bool(self._narrow)

    def edges(self, face: int) -> list[tuple[float, int, int]]:
        """(length, lower vertex, higher vertex) of a face's edges."""
        loop = self.loops[face]
        ends = [(min(a, b), max(a, b)) for a, b in pairwise([*loop, loop[0]])]
        lengths = np.linalg.norm(self.points[[a for a, _ in ends]] - self.points[[b for _, b in ends]], axis=1)
        return [(length, a, b) for length, (a, b) in zip(lengths.tolist(), ends)]

    def merge(self, a: int, b: int, narrow: float) -> bool:
        """Makes b and a one vertex, unless a grain around would lose its soundness or get an angle below ``narrow``.

        Returns whether they are one now
        """
        around = self.faces_at[a] | self.faces_at[b]
        loops = {face: without_repeats([a if v == b else v for v in self.loops[face]]) for face in sorted(around)}
        if any(loop.count(a) > 1 for loop in loops.values()):
            return False
        grains = {cell for face in around for cell in self.cells[face] if cell >= 0}
        narrow = min(narrow, *(self._narrow[grain] for grain in grains))
        return any(self._merge_at(a, b, place, loops, grains, narrow) for place in self._places(a, b))

    def _places(self, a: int, b: int) -> list[np.ndarray]:
        """Places for the merged vertex, so that what lies on sides of the box stays there."""
        more, less = np.all(self.sides[a] >= self.sides[b]), np.all(self.sides[b] >= self.sides[a])
        if more and less:
            return [(self.points[a] + self.points[b]) / 2, self.points[a], self.points[b]]
        return [self.points[a]] if more else [self.points[b]] if less else []

    def _merge_at(self, a: int, b: int, place: np.ndarray, loops: dict[int, list[int]], grains: set[int], narrow: float) -> bool:
        before = self.points[a].copy()
        self.points[a] = place
        whole = {face: loop for face, loop in loops.items() if len(loop) > 2}
        triangles = {face: [] for face in loops} | dict(zip(whole, cut(self.points, list(whole.values()))))
        found = self._narrowest(grains, triangles)
        if found is None or min(found.values()) < narrow:
            self.points[a] = before
            return False
        self._narrow |= found
        self.sides[a] |= self.sides[b]
        for face in loops:
            if triangles[face]:
                self.loops[face], self.triangles[face] = loops[face], triangles[face]
                continue
            del self.triangles[face]
            for vertex in set(self.loops.pop(face)):
                self.faces_at[vertex].discard(face)
            for cell in self.cells.pop(face):
                self.faces_of[cell].discard(face)
        self.faces_at[a] = {face for face in loops if face in self.loops}
        del self.faces_at[b]
        return True

    def _narrowest(self, grains: set[int], changed: dict[int, list | None]) -> dict[int, float] | None:
        """See ``narrowest``; ``changed`` takes the place of some faces' triangles."""
        triangles, body = [], []
        for grain in sorted(grains):
            for face in sorted(self.faces_of[grain]):
                parts = changed.get(face, self.triangles[face])
                if parts is None:
                    return None
                triangles += parts if self.cells[face][0] == grain else [part[::-1] for part in parts]
                body += [grain] * len(parts)
        found = narrowest(self.points, np.array(triangles), np.array(body))
        return None if found is None else dict(zip(sorted(grains), found.tolist()))


def tidied(cells: Tessellation, h: float) -> Grains:
    """The grains of a tessellation fit for elements of size h: short edges and tiny interfaces merged away.

    Where merging would fold, flatten or tear a grain, the edge stays.
    """
    grains = Grains(cells)
    if not grains.sound:
        return grains
    typical = np.cbrt(np.prod(cells.size) / len([cell for cell in grains.faces_of if cell >= 0]))
    _merge_short(grains, min(SHORT_H * h, SHORT_GRAIN * typical))
    _merge_tiny(grains, h, LONG_GRAIN * typical)
    return grains


def _merge_short(grains: Grains, limit: float) -> None:
    """Merges the ends of edges shorter than the limit, the shortest first."""
    merged = True
    while merged:
        merged, touched = False, set()
        for length, a, b in sorted({edge for face in grains.loops for edge in grains.edges(face)}):
            if length >= limit:
                break
            # Around a merged vertex lengths have changed: their turn comes in the next round.
            if a in touched or b in touched or not grains.merge(a, b, NARROW):
                continue
            merged, touched = True, touched | {v for face in grains.faces_at[a] for v in grains.loops[face]} | {b}


def _merge_tiny(grains: Grains, h: float, limit: float) -> None:
    """Merges edges of interfaces with too few nodes, the smallest interface first."""
    merged = True
    while merged:
        merged = False
        tiny = sorted((count, face) for face, (_, other) in grains.cells.items()
                      if other >= 0 and (count := expected_nodes(grains, face, h)) < FEW_NODES)
        for _, face in tiny:
            if face not in grains.loops or expected_nodes(grains, face, h) >= FEW_NODES:
                continue
            for length, a, b in sorted(grains.edges(face)):
                if length < limit and grains.merge(a, b, NARROWEST):
                    merged = True
                    break


def expected_nodes(grains: Grains, face: int, h: float) -> float:
    """About how many nodes a face gets with elements of size h."""
    segments = sum(max(1, np.ceil(length / h - 0.01)) for length, _, _ in grains.edges(face))
    area = np.linalg.norm(area_vector(grains.points[grains.loops[face]]))
    triangles = max(area / (np.sqrt(3) / 4 * h**2), segments - 2)
    return triangles / 2 + segments / 2 + 1
