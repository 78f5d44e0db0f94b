"""A box of grains: Voronoi cells, tidied, each meshed so that neighbours share their interfaces.

Bad tets mended where they are: their nodes are moved, all else stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import QhullError

from orchestrator.errors import wrong
from orchestrator.linalg import SAME, svd, WRITTEN
from orchestrator.optional import check_there
from orchestrator.scene.mesh.checks import check_size, coarser, DENSITY
from orchestrator.scene.mesh.faces import renumbered
from orchestrator.scene.mesh.geometry import (
    dihedral_angles, dihedral_range, facet_normals, roundness, unit)
from orchestrator.scene.mesh.grains.grain_meshes import Failed, grain_mesh, GrainMesh
from orchestrator.scene.mesh.grains.polyhedra import scattered, Tessellation
from orchestrator.scene.mesh.grains.tidied import tidied
from orchestrator.scene.mesh.mesh import Mesh


PATH = ("mesh", "polycrystal")
# How many seeds are tried, one after another.
TRIES = 10
# The worst tet accepted: its roundness (1 for the regular one), its dihedral angles in degrees.
ROUND, ANGLE = 0.05, 4.0
# Bad tets are mended one by one while they are few, a few per grain; when this share of all is bad,
# h suits no grain.
FEW = 0.02

def polycrystal(mesh: Any) -> Mesh:
    """Grains from ``mesh.polycrystal`` with ``grains`` (count), ``size`` (a length or three),
    ``h``, ``seed``, ``lloyd``.

    Volumes are named grain_1, grain_2, …, the sides of the box xmin, xmax, ymin, …. Where tets are
    bad, they are mended; when the grains of a seed cannot be meshed at all, the next seed is taken;
    ``remarks`` tell of both. The same entry always gives the same mesh; size and h times ten give
    that mesh times ten.

    Raises InputError: h too coarse or too fine, or no seed gives a good mesh
    """
    entry = mesh.polycrystal
    _check(entry)
    count, h, seed = int(entry.grains), float(entry.h), int(entry.seed)
    size = np.broadcast_to(np.asarray(entry.size, dtype=float), (3,))
    # gmsh's tolerances are absolute: what it sees is at most 1 long, and the same in every unit.
    unit = size.max()
    relative, fine, complaints = np.round(size / unit, 12), round(h / unit, 12), []
    for current in range(seed, seed + TRIES):
        cells = _cells(count, relative, fine, current, int(entry.lloyd))
        made = cells if isinstance(cells, str) else _meshed(cells, fine)
        if not isinstance(made, str):
            whole, remarks = made
            source = f"polycrystal of {count} grains, seed {current}"
            remarks = [f"{source}: {remark}"
                       for remark in (*(f"passed over {complaint}" for complaint in complaints),
                                      *remarks)]
            return Mesh(whole.points / relative * size, whole.cells, whole.grain,
                        [f"grain_{i + 1}" for i in range(count)],
                        whole.sides(relative), source, remarks)
        complaints.append(f"seed {current}: {made}")
    raise wrong(PATH, f"no good mesh with seeds {seed} to {current}; {complaints[-1]}",
                f"tets rounder than {ROUND} with dihedral angles above {ANGLE:g} degrees",
                "take a smaller h, lloyd: 10 for rounder grains, or another seed")


def _check(entry: Any) -> None:
    """Raise InputError where h is too coarse or too fine, or gmsh is missing."""
    count, h, size = int(entry.grains), float(entry.h), np.broadcast_to(
        np.asarray(entry.size, dtype=float), (3,))
    typical = min(float(np.cbrt(np.prod(size) / count)), float(size.min()))
    if h > typical:
        raise wrong((*PATH, "h"), f"h = {h:g}, where grains measure about {typical:.3g}",
                    "elements smaller than the grains", f"take h: {typical / 3:.2g} or less")
    check_size(DENSITY * np.prod(size / h), (*PATH, "h"), f"h = {h:g}", coarser(h))
    check_there("gmsh")


def _cells(count: int, size: np.ndarray, h: float, seed: int, lloyd: int) -> Tessellation | str:
    """The grains of one seed before they are meshed, or what is wrong with it."""
    try:
        grains = tidied(scattered(count, size, seed, lloyd), h)
    except QhullError:
        return "no Voronoi cells"
    return grains.plane() if grains.sound else "grains are folded"


def _meshed(cells: Tessellation, h: float) -> tuple[GrainMesh, list[str]] | str:
    """Return the grains, mended if need be, with remarks; or what is wrong with one."""
    try:
        whole, done = grain_mesh(cells, h), []
    except Failed as error:
        return str(error)
    fit = _fitness(whole.points, whole.cells)
    if 0 < np.sum(fit < 1) < FEW * len(fit):
        mending = Mending(whole, _fitness)
        whole = replace(whole, points=mending.points)
        fit = _fitness(whole.points, whole.cells)
        done = [f"mended where tets were bad: {mending.told(h)}"]
    if fit.min() >= 1:
        return whole, done
    sharp, blunt = dihedral_range(whole.points, whole.cells)
    round_ = roundness(whole.points, whole.cells).min()
    return f"a tet of roundness {round_:.2g}, dihedral angles {sharp:.2g} to {blunt:.4g} degrees"


def _fitness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) how good tets are, below 1 where they are not accepted; -1 without volume."""
    sharp, blunt = dihedral_angles(nodes, cells)
    with np.errstate(invalid="ignore"):
        found = np.minimum(roundness(nodes, cells) / ROUND, np.minimum(sharp, 180 - blunt) / ANGLE)
    return np.where(np.isfinite(found), found, -1.0)


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
            if off > WRITTEN * np.linalg.norm(way):
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
        free = axes[int(np.sum(lengths > WRITTEN * lengths[0])):].T
        # so that what lies on a side of a box stays on it exactly
        return np.where(np.abs(free) < SAME, 0.0, free)

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
