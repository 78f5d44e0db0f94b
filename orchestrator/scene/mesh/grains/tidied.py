"""Grains that can be meshed: a tessellation without short edges and tiny interfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from orchestrator.scene.mesh.grains.polyhedra import (
    area_vector, cut, loop_vectors, narrowest, Tessellation, without_repeats)

# Edges are removed below 2.2 h, so that they have two elements, but never above a fifth of a
# grain's size,
# where grains lose their shape.
SHORT_H, SHORT_GRAIN = 2.2, 0.2
# An interface needs 6 nodes for the 12 affine modes of traction and more; edges up to this share of
# a
# grain's size go for it.
FEW_NODES, LONG_GRAIN = 6, 0.5
# No merger may make an angle smaller than this, in radians (10 degrees; 5 where a tiny interface is
# at stake).
NARROW, NARROWEST = np.pi / 18, np.pi / 36
# Faces whose corners leave their plane by more than this share of the box's longest side are cut
# into triangles.
FLAT = 1e-7


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
        self.size, self.points, self.sides = cells.size, cells.vertices.copy(), cells.sides.copy()
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

    def plane(self) -> Tessellation:
        """Return what they are now, with plane faces: those that are not are cut into their
        triangles.
        """
        parts = [(list(part), self.cells[face]) for face, loop in sorted(self.loops.items())
                 for part in ([loop] if _flat(self.points[loop]) else self.triangles[face])]
        kept, corners = np.unique(np.concatenate([loop for loop, _ in parts]), return_inverse=True)
        loops = np.split(corners, np.cumsum([len(loop) for loop, _ in parts])[:-1])
        return Tessellation(self.size, self.points[kept], self.sides[kept],
                            [loop.tolist() for loop in loops],
                            np.array([cells for _, cells in parts]))

    def edges(self, faces: Iterable[int]) -> tuple[np.ndarray, np.ndarray]:
        """(k,) lengths, and (k, 2) int lower and higher vertex, of the edges of faces, one face
        after the other in the order of its loop.
        """
        loops = [self.loops[face] for face in faces]
        ends = np.array([(v, w) for loop in loops for v, w in zip(loop, [*loop[1:], loop[0]])])
        ends.sort(axis=1)
        return np.linalg.norm(self.points[ends[:, 0]] - self.points[ends[:, 1]], axis=1), ends

    def merge(self, a: int, b: int, narrow: float) -> bool:
        """Makes b and a one vertex, unless a grain around would lose its soundness or get an angle
        below ``narrow``.

        Returns whether they are one now
        """
        around = self.faces_at[a] | self.faces_at[b]
        loops = {face: without_repeats([a if v == b else v for v in self.loops[face]])
                 for face in sorted(around)}
        if any(loop.count(a) > 1 for loop in loops.values()):
            return False
        grains = {cell for face in around for cell in self.cells[face] if cell >= 0}
        narrow = min(narrow, *(self._narrow[grain] for grain in grains))
        return any(self._merge_at(a, b, place, loops, grains, narrow)
                   for place in self._places(a, b))

    def _places(self, a: int, b: int) -> list[np.ndarray]:
        """Places for the merged vertex, so that what lies on sides of the box stays there."""
        more, less = np.all(self.sides[a] >= self.sides[b]), np.all(self.sides[b] >= self.sides[a])
        if more and less:
            return [(self.points[a] + self.points[b]) / 2, self.points[a], self.points[b]]
        return [self.points[a]] if more else [self.points[b]] if less else []

    def _merge_at(self, a: int, b: int, place: np.ndarray, loops: dict[int, list[int]],
                  grains: set[int], narrow: float) -> bool:
        before = self.points[a].copy()
        self.points[a] = place
        whole = {face: loop for face, loop in loops.items() if len(loop) > 2}
        triangles = {face: [] for face in loops} | dict(
            zip(whole, cut(self.points, list(whole.values()))))
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

    def _narrowest(self, grains: set[int],
                   changed: dict[int, list | None]) -> dict[int, float] | None:
        """See ``narrowest``; ``changed`` takes the place of some faces' triangles."""
        triangles, body = [], []
        for grain in sorted(grains):
            for face in sorted(self.faces_of[grain]):
                parts = changed.get(face, self.triangles[face])
                if parts is None:
                    return None
                triangles += parts if self.cells[face][0] == grain else [
                    part[::-1] for part in parts]
                body += [grain] * len(parts)
        found = narrowest(self.points, np.array(triangles), np.array(body))
        return None if found is None else dict(zip(sorted(grains), found.tolist()))


def _flat(corners: np.ndarray) -> bool:
    normal = area_vector(corners)
    return bool(np.ptp(corners @ normal) <= FLAT * np.linalg.norm(normal))


def tidied(cells: Tessellation, h: float) -> Grains:
    """The grains of a tessellation fit for elements of size h: short edges and tiny interfaces
    merged away.

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
        lengths, ends = grains.edges(grains.loops)
        short = lengths < limit
        for _, a, b in sorted(set(zip(lengths[short].tolist(), *ends[short].T.tolist()))):
            # Around a merged vertex lengths have changed: their turn comes in the next round.
            if a in touched or b in touched or not grains.merge(a, b, NARROW):
                continue
            merged, touched = True, touched | {v for face in grains.faces_at[a]
                                               for v in grains.loops[face]} | {b}


def _merge_tiny(grains: Grains, h: float, limit: float) -> None:
    """Merges edges of interfaces with too few nodes, the smallest interface first."""
    merged = True
    while merged:
        merged = False
        inner = [face for face, (_, other) in grains.cells.items() if other >= 0]
        tiny = sorted((count, face)
                      for face, count in zip(inner, expected_nodes(grains, inner, h).tolist())
                      if count < FEW_NODES)
        for _, face in tiny:
            if face not in grains.loops or expected_nodes(grains, [face], h)[0] >= FEW_NODES:
                continue
            lengths, ends = grains.edges([face])
            for length, a, b in sorted(zip(lengths.tolist(), *ends.T.tolist())):
                if length < limit and grains.merge(a, b, NARROWEST):
                    merged = True
                    break


def expected_nodes(grains: Grains, faces: Sequence[int], h: float) -> np.ndarray:
    """(k,) about how many nodes faces get with elements of size h."""
    if not faces:
        return np.empty(0)
    loops = [grains.loops[face] for face in faces]
    starts = np.cumsum([0, *(len(loop) for loop in loops[:-1])])
    segments = np.add.reduceat(np.maximum(1, np.ceil(grains.edges(faces)[0] / h - 0.01)), starts)
    area = np.linalg.norm(loop_vectors(grains.points, loops), axis=1)
    triangles = np.maximum(area / (np.sqrt(3) / 4 * h**2), segments - 2)
    return triangles / 2 + segments / 2 + 1
