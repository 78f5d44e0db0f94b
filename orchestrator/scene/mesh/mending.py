"""Bad tets mended where they are: nodes moved, short edges merged away; all else stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.stars import IN_PLANE, Stars
from orchestrator.scene.mesh.mesh import Mesh

# How good tets (m, 4) of nodes (n, 3) are: below 1 they are bad, without volume not above 0.
Fitness = Callable[[np.ndarray, np.ndarray], np.ndarray]
# A node is moved until the worst tet around is this good, with some room above 1; a change that makes it better by
# less than this share does not count, so that mending ends.
GOOD, GAIN = 1.5, 0.01
# Random directions tried at a time, times that they are, and the share of the way that is left after none was better:
# the last steps are a hundredth of the first, which is half the shortest edge.
DIRECTIONS, TRIALS, SHORTER = 12, 24, 0.7


@dataclass
class Mended:
    """What was done to a mesh.

    Parameters
    ----------
    moved : times that a node was moved
    merged : edges whose ends have become one node
    bent : how many of these had to leave a plane face between volumes
    by : the farthest that a node has left it, a length
    """

    moved: int = 0
    merged: int = 0
    bent: int = 0
    by: float = 0.0

    def told(self, h: float) -> str:
        """In words, for elements of size h."""
        def counted(count: int, what: str) -> str:
            return f"{count} {what}" + ("s" if count != 1 else "")
        bent = f"; {self.bent} of these bend faces between bodies, by {self.by / h:.2g} of h at most" if self.bent else ""
        return f"{counted(self.moved, 'node')} moved, {counted(self.merged, 'short edge')} merged{bent}"


def mend(mesh: Mesh, fitness: Fitness) -> tuple[Mesh, Mended]:
    """Makes bad tets better, the worst first, until none is bad or none gets better.

    What is near a bad tet changes, by the best of: one of its nodes moved, the nodes of one of its edges made one;
    the worst tet around always gains. Nodes stay on the named surfaces, volumes stay connected as they are
    (``Stars.may_merge``) and touch node for node. Only where nothing else helps do faces between volumes bend.

    Parameters
    ----------
    mesh : its surfaces must cover its outside and be plane
    """
    stars, done = Stars(mesh), Mended()
    bad = _bad(stars, np.arange(stars.real), fitness)
    for bend in (False, True):
        better = True
        while len(bad) and better:
            changed = [_mended_at(stars, cell, fitness, bend, done) for cell in bad.tolist()]
            better = any(map(len, changed))
            bad = _bad(stars, np.unique(np.concatenate([bad, *changed])), fitness)
    return stars.compact(), done


def _bad(stars: Stars, cells: np.ndarray, fitness: Fitness) -> np.ndarray:
    """Those of the tets that are bad, the worst first."""
    cells = cells[stars.alive[cells]]
    found = fitness(stars.nodes, stars.cells[cells])
    order = np.argsort(found, kind="stable")
    return cells[order[found[order] < 1]]


def _mended_at(stars: Stars, cell: int, fitness: Fitness, bend: bool, done: Mended) -> np.ndarray:
    """Takes the best change near a bad tet; the tets that it has touched, none where nothing helps."""
    if not stars.alive[cell] or fitness(stars.nodes, stars.cells[[cell]])[0] >= 1:
        return np.empty(0, dtype=int)
    corners, best, change = stars.cells[cell].tolist(), 0.0, None
    for u in corners:
        around = stars.star(u)
        cells = stars.cells[around[around < stars.real]]
        # Better than the worst around is not enough: what counts is how much better it gets.
        was, free = fitness(stars.nodes, cells).min(), stars.free(u, bend)
        found, place = _moved(stars.nodes, cells, u, free, was, fitness)
        if found > max(best, was + GAIN * abs(was)):
            best, change = found, (u, place, None)
        for v in corners:
            way = stars.nodes[v] - stars.nodes[u]
            if v == u or _off(way, free) > IN_PLANE * np.linalg.norm(way):
                continue
            left = cells[~np.any(cells == v, axis=1)]
            found = fitness(stars.nodes, np.where(left == u, v, left)).min() if len(left) else 0.0
            if found > max(best, was + GAIN * abs(was)) and stars.may_merge(u, v):
                best, change = found, (u, stars.nodes[v], v)
    if change is None:
        return np.empty(0, dtype=int)
    u, place, v = change
    off = _off(place - stars.nodes[u], stars.free(u))
    if off > IN_PLANE * np.linalg.norm(place - stars.nodes[u]):
        done.bent, done.by = done.bent + 1, max(done.by, off)
    touched = stars.star(u)
    if v is None:
        stars.nodes[u] = place
        done.moved += 1
    else:
        stars.merge(u, v)
        done.merged += 1
    return touched[touched < stars.real]


def _off(way: np.ndarray, free: np.ndarray) -> float:
    """How far a vector leads out of the space of orthonormal directions (3, k)."""
    return float(np.linalg.norm(way - free @ (free.T @ way)))


def _moved(nodes: np.ndarray, cells: np.ndarray, node: int, free: np.ndarray, was: float,
           fitness: Fitness) -> tuple[float, np.ndarray]:
    """Where a node best goes, in some directions (3, k), and how good the worst of its tets (m, 4) is there."""
    place, best = nodes[node], was
    if not free.shape[1]:
        return best, place
    used, local = np.unique(cells, return_inverse=True)
    corners, local = nodes[used], local.reshape(-1, 4)
    at = int(np.searchsorted(used, node))
    step = np.linalg.norm(np.delete(corners, at, axis=0) - place, axis=1).min() / 2
    # All trials in one call: as many copies of the nodes, side by side.
    trials = np.repeat(corners[None], DIRECTIONS, axis=0)
    tets = (local + len(used) * np.arange(DIRECTIONS)[:, None, None]).reshape(-1, 4)
    random = np.random.default_rng(0)
    for _ in range(TRIALS):
        ways = random.standard_normal((DIRECTIONS, free.shape[1]))
        trials[:, at] = place + step * (ways / np.linalg.norm(ways, axis=1)[:, None]) @ free.T
        found = fitness(trials.reshape(-1, 3), tets).reshape(DIRECTIONS, -1).min(axis=1)
        first = int(found.argmax())
        if found[first] <= best:
            step *= SHORTER
            continue
        place, best = trials[first, at].copy(), float(found[first])
        if best >= GOOD:
            break
    return best, place
