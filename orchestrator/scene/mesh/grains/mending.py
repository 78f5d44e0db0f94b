"""Bad tets mended where they are: their nodes are moved, all else stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from orchestrator.linalg import svd
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.geometry import facet_normals, unit
from orchestrator.scene.mesh.grains.grain_meshes import GrainMesh

# How good tets (m, 4) of nodes (n, 3) are: below 1 they are bad, without volume not above 0.
Fitness = Callable[[np.ndarray, np.ndarray], np.ndarray]
# A node is moved until the worst tet around is this good, with some room above 1; a change that
# makes it better by
# less than this share does not count, so that mending ends.
GOOD, GAIN = 1.5, 0.01
# Random directions tried at a time, times that they are, and the share of the way that is left
# after none was better:
# the last steps are a hundredth of the first, which is half the shortest edge.
DIRECTIONS, TRIALS, SHORTER = 12, 24, 0.7
# Directions this close to a plane (sine of the angle) lie in it; components this small are
# rounding.
IN_PLANE, ROUNDING = 1e-6, 1e-12


class Mending:
    """Makes bad tets of grains better, the worst first, until none is bad or none gets better.

    Of each bad tet one node moves, that by which the worst tet around gains most. Nodes stay in
    plane faces between grains and of the box. Only where nothing else helps do faces between
    grains bend.

    points : (n, 3) where nodes are now
    moved, bent, by : times that a node was moved, how many of these have bent a face, and how far
        off it they are at most, a length
    """

    def __init__(self, mesh: GrainMesh, fitness: Fitness):
        self.points, self.cells, self.grain = mesh.points.copy(), mesh.cells, mesh.grain
        self._fitness = fitness
        self.moved, self.bent, self.by = 0, 0, 0.0
        order = np.argsort(self.cells, axis=None, kind="stable")
        starts = np.searchsorted(self.cells.ravel()[order], np.arange(1, len(self.points)))
        self._at = np.split(order // 4, starts)  # cells by node
        bad = self._bad(np.arange(len(self.cells)))
        for bend in (False, True):
            better = True
            while len(bad) and better:
                changed = [self._mended_at(cell, bend) for cell in bad.tolist()]
                better = any(map(len, changed))
                bad = self._bad(np.unique(np.concatenate([bad, *changed])))

    def told(self, h: float) -> str:
        """The changes in words, for elements of size h."""
        bent = (
            f"; {self.bent} of these bend faces between bodies, by {self.by / h:.2g} of h at most"
            if self.bent else "")
        return f"{self.moved} node{'s' * (self.moved != 1)} moved{bent}"

    def _bad(self, cells: np.ndarray) -> np.ndarray:
        """Bad tets, the worst first."""
        found = self._fitness(self.points, self.cells[cells])
        order = np.argsort(found, kind="stable")
        return cells[order[found[order] < 1]]

    def _mended_at(self, cell: int, bend: bool) -> np.ndarray:
        """Move a node of a bad tet; the tets that it touches, none where nothing helps."""
        touched, best = np.empty(0, int), 0.0
        if self._fitness(self.points, self.cells[[cell]])[0] >= 1:
            return touched
        for u in self.cells[cell].tolist():
            # Better than the worst around is not enough: what counts is how much better it gets.
            was = self._fitness(self.points, self.cells[self._at[u]]).min()
            found, to = self._moved(u, self._free(u, bend), was)
            if found > max(best, was + GAIN * abs(was)):
                best, node, place, touched = found, u, to, self._at[u]
        if len(touched):
            way, free = place - self.points[node], self._free(node)
            off = float(np.linalg.norm(way - free @ (free.T @ way)))
            if off > IN_PLANE * np.linalg.norm(way):
                self.bent, self.by = self.bent + 1, max(self.by, off)
            self.points[node] = place
            self.moved += 1
        return touched

    def _free(self, node: int, bend: bool = False) -> np.ndarray:
        """(3, k) orthonormal directions in which a node moves within all faces between grains, and
        of the box, that it lies on.

        bend : faces between two grains may bend
        """
        beside: dict[tuple[int, ...], list[int]] = {}
        for cell in self._at[node]:
            for pair in combinations(sorted(v for v in self.cells[cell].tolist() if v != node), 2):
                beside.setdefault(pair, []).append(self.grain[cell])
        between = [(node, *pair) for pair, grains in beside.items()
                   if len(grains) == 1 or (grains[0] != grains[1] and not bend)]
        if not between:
            return np.eye(3)
        _, lengths, axes = svd(facet_normals(self.points, np.array(between))[0])
        free = axes[int(np.sum(lengths > IN_PLANE * lengths[0])):].T
        # so that what lies on a side of a box stays on it exactly
        return np.where(np.abs(free) < ROUNDING, 0.0, free)

    def _moved(self, node: int, free: np.ndarray, was: float) -> tuple[float, np.ndarray]:
        """Best place of a node, in some directions (3, k), and the quality of the worst of its
        tets there.
        """
        place, best = self.points[node], was
        if not free.shape[1]:
            return best, place
        used, local = renumbered(self.cells[self._at[node]])
        at, points = int(np.searchsorted(used, node)), self.points[used]
        step = np.linalg.norm(np.delete(points, at, axis=0) - place, axis=1).min() / 2
        # All trials in one call: as many copies of the nodes, side by side.
        trials = np.repeat(points[None], DIRECTIONS, axis=0)
        tets = local + len(used) * np.arange(DIRECTIONS)[:, None, None]
        random = np.random.default_rng(0)
        for _ in range(TRIALS):
            ways = random.standard_normal((DIRECTIONS, free.shape[1]))
            trials[:, at] = place + step * unit(ways) @ free.T
            found = self._fitness(trials.reshape(-1, 3),
                                  tets.reshape(-1, 4)).reshape(DIRECTIONS, -1).min(axis=1)
            first = int(found.argmax())
            if found[first] <= best:
                step *= SHORTER
                continue
            place, best = trials[first, at].copy(), float(found[first])
            if best >= GOOD:
                break
        return best, place
