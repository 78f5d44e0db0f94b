"""Bad tets mended where they are: nodes moved, short edges merged away; all else stays as it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from orchestrator.linalg import svd
from orchestrator.scene.mesh.geometry import facet_normals
from orchestrator.scene.mesh.mesh import Mesh

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


@dataclass
class Mended:
    """Changes made to a mesh: times that a node was moved; edges whose ends have become one node;
    how many of these had to
    leave a plane face between volumes, and the farthest that a node has left it, a length."""

    moved: int = 0
    merged: int = 0
    bent: int = 0
    by: float = 0.0

    def __add__(self, other: Mended) -> Mended:
        return Mended(self.moved + other.moved, self.merged + other.merged, self.bent + other.bent,
                      max(self.by, other.by))

    def told(self, h: float) -> str:
        """The changes in words, for elements of size h."""
        bent = f"; {self.bent} of these bend faces between bodies, by {self.by / h:.2g} of h at most" if self.bent else ""
        return f"{self.moved} node{'s' * (self.moved != 1)} moved, {self.merged} short edge{'s' * (self.merged != 1)} merged{bent}"


def mend(mesh: Mesh, fitness: Fitness, held: np.ndarray
         | None = None) -> tuple[Mesh, np.ndarray, Mended]:
    """Makes bad tets better, the worst first, until none is bad or none gets better.

    What is near a bad tet changes, by the best of: one of its nodes moved, the nodes of one of its
    edges made one; the worst tet around always gains. Nodes stay on the named surfaces, volumes
    stay connected as they are (``Stars.may_merge``) and touch node for node. Only where nothing
    else helps do faces between volumes bend.

    mesh : its surfaces must cover its outside and be plane, but for faces whose nodes are all held
    held : (n,) bool, nodes that stay as they are; none
    Returns the mesh as it is then, (k,) int, which of the nodes these are, and what was done
    """
    stars, done = Stars(mesh, held), Mended()
    bad = _bad(stars, np.arange(stars.real), fitness)
    for bend in (False, True):
        better = True
        while len(bad) and better:
            changed = [_mended_at(stars, cell, fitness, bend, done) for cell in bad.tolist()]
            better = any(map(len, changed))
            bad = _bad(stars, np.unique(np.concatenate([bad, *changed])), fitness)
    return *stars.compact(), done


def _bad(stars: Stars, cells: np.ndarray, fitness: Fitness) -> np.ndarray:
    """Bad tets, the worst first."""
    cells = cells[stars.alive[cells]]
    found = fitness(stars.nodes, stars.cells[cells])
    order = np.argsort(found, kind="stable")
    return cells[order[found[order] < 1]]


def _mended_at(stars: Stars, cell: int, fitness: Fitness, bend: bool, done: Mended) -> np.ndarray:
    """Takes the best change near a bad tet; the tets that it has touched, none where nothing
    helps.
    """
    if not stars.alive[cell] or fitness(stars.nodes, stars.cells[[cell]])[0] >= 1:
        return np.empty(0, dtype=int)
    corners, best, change = stars.cells[cell].tolist(), 0.0, None
    corners = [u for u in corners if not stars.held[u]]
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
    """Distance of a vector from the space of orthonormal directions (3, k)."""
    return float(np.linalg.norm(way - free @ (free.T @ way)))


def _moved(nodes: np.ndarray, cells: np.ndarray, node: int, free: np.ndarray, was: float,
           fitness: Fitness) -> tuple[float, np.ndarray]:
    """Best place of a node, in some directions (3, k), and the quality of the worst of its tets (m,
    4) there.
    """
    place, best = nodes[node], was
    if not free.shape[1]:
        return best, place
    used, local = np.unique(cells, return_inverse=True)
    at = int(np.searchsorted(used, node))
    step = np.linalg.norm(np.delete(nodes[used], at, axis=0) - place, axis=1).min() / 2
    # All trials in one call: as many copies of the nodes, side by side.
    trials = np.repeat(nodes[used][None], DIRECTIONS, axis=0)
    tets = (local.reshape(-1, 4) + len(used) * np.arange(DIRECTIONS)[:, None, None]).reshape(-1, 4)
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


class Stars:
    """The tets around each node of a mesh that is changed in few places, those beyond its outer
    surface too.

    Beyond every outer triangle lies an imagined tet, up to one node at infinity, which belongs to
    the triangle's named surface as others belong to their volume. So what bounds volumes and what
    bounds the mesh is one kind of face, between tets of different regions, and nothing has an
    outside.

    nodes : (n, 3) coordinates
    cells : (m, 4) int, the mesh's tets, then the imagined ones, whose last node is n; real : how
        many are the mesh's
    region : (m,) int, index of the volume; surfaces follow
    alive : (m,) bool, tets that have not vanished
    held : (n,) bool, nodes that stay as they are: the tets around them are not all here
    """

    def __init__(self, mesh: Mesh, held: np.ndarray | None = None):
        self.mesh, self.nodes, self.real, n = mesh, mesh.nodes.copy(), len(mesh.cells), len(
            mesh.nodes)
        self.held = np.zeros(n, dtype=bool) if held is None else held
        beyond = [np.c_[triangles, np.full(len(triangles), n)]
                  for triangles in mesh.surfaces.values()]
        self.cells = np.concatenate([mesh.cells, *beyond])
        self.region = np.r_[mesh.volume,
                            np.repeat(len(mesh.volumes) + np.arange(len(beyond)),
                                      [len(part) for part in beyond])]
        self.alive = np.ones(len(self.cells), dtype=bool)
        order = np.argsort(self.cells.reshape(-1), kind="stable")
        start = np.searchsorted(self.cells.reshape(-1)[order], np.arange(1, n + 1))
        self._at = np.split(order // 4, start)  # cells by node

    def star(self, node: int) -> np.ndarray:
        """Tets at a node, ascending."""
        return np.unique(self._at[node][self.alive[self._at[node]]])

    def free(self, node: int, bend: bool = False) -> np.ndarray:
        """(3, k) orthonormal directions in which a node moves within all faces between regions that
        it lies on.

        bend : faces between two volumes may bend
        """
        cells_at: dict[tuple[int, ...], list[int]] = {}
        for cell in self.star(node).tolist():
            for pair in _opposite(self.cells[cell].tolist(), node):
                cells_at.setdefault(pair, []).append(cell)
        between = [(node, *pair) for pair, (one, other) in cells_at.items()
                   if pair[1] < len(self.nodes) and self.region[one] != self.region[other]
                   and not (bend and max(one, other) < self.real)]
        if not between:
            return np.eye(3)
        _, lengths, axes = svd(facet_normals(self.nodes, np.array(between))[0])
        free = axes[int(np.sum(lengths > IN_PLANE * lengths[0])):].T
        # so that what lies on a side of a box stays on it exactly
        return np.where(np.abs(free) < ROUNDING, 0.0, free)

    def may_merge(self, u: int, v: int) -> bool:
        """Whether nodes u and v of an edge can become one so that every region stays what it is: a
        ball stays a ball.

        This is so when what surrounds both surrounds their edge: among all tets, in each region and
        on its surface (the link conditions of Dey, Edelsbrunner, Guha & Nekhayev, Publ. Inst. Math.
        66, 1999). Faces between two regions stay in one piece, or vanish where they are a triangle
        with one side too short.
        """
        at_u, at_v = self.star(u), self.star(v)
        around_u, around_v = set(self.region[at_u].tolist()), set(self.region[at_v].tolist())
        around_edge = set(self.region[np.intersect1d(at_u, at_v)].tolist())
        if len(around_edge) == 2 and len(around_u) > 2 and len(around_v) > 2:
            return False  # a face between two regions would be cut in two
        if _links_meet_elsewhere(self.cells[at_u].tolist(), self.cells[at_v].tolist(), u, v):
            return False
        for region in around_u & around_v:
            inside_u, inside_v = (self.cells[at[self.region[at] == region]].tolist()
                                  for at in (at_u, at_v))
            if _links_meet_elsewhere(inside_u, inside_v, u, v):
                return False
            surface_u, surface_v = _surface(inside_u, u), _surface(inside_v, v)
            if surface_u and surface_v and _links_meet_elsewhere(surface_u, surface_v, u, v):
                return False
        return True

    def merge(self, u: int, v: int) -> None:
        """Node u becomes node v."""
        around = self.star(u)
        both = np.any(self.cells[around] == v, axis=1)
        self.alive[around[both]] = False
        moved = around[~both]
        self.cells[moved] = np.where(self.cells[moved] == u, v, self.cells[moved])
        self._at[v] = np.concatenate([self._at[v], moved])

    def compact(self) -> tuple[Mesh, np.ndarray]:
        """The mesh as it is now, without what has vanished, and which nodes are left."""
        kept, mesh = np.flatnonzero(self.alive), self.mesh
        inside, beyond = kept[kept < self.real], kept[kept >= self.real]
        used, cells = np.unique(self.cells[inside], return_inverse=True)
        surfaces = {
            name: np.searchsorted(used,
                                  self.cells[beyond[self.region[beyond] == len(mesh.volumes) + i],
                                             :3])
                    for i, name in enumerate(mesh.surfaces)}
        return Mesh(self.nodes[used], cells.reshape(-1, 4), self.region[inside], mesh.volumes,
                    surfaces, mesh.source, list(mesh.remarks)), used


def _opposite(cell: list[int], node: int) -> Iterable[tuple[int, ...]]:
    """Pairs of a tet's other nodes, each with node one of its faces."""
    return combinations(sorted(v for v in cell if v != node), 2)


def _parts(simplices: Iterable[list[int]]) -> set[frozenset[int]]:
    """Simplices, their sides and their corners."""
    return {frozenset(part) for nodes in simplices for k in range(1, len(nodes) + 1)
            for part in combinations(nodes, k)}


def _links_meet_elsewhere(at_u: list[list[int]], at_v: list[list[int]], u: int, v: int) -> bool:
    """Whether the links of two nodes, which are what faces them in their tets or triangles, have
    more in common than the link of
    their edge; or there is no such edge."""
    edge = [[w for w in cell if w not in (u, v)] for cell in at_u if v in cell]
    link_u, link_v = (_parts([w for w in cell if w != node] for cell in at)
                      for at, node in ((at_u, u), (at_v, v)))
    return not edge or link_u & link_v != _parts(edge)


def _surface(cells: list[list[int]], node: int) -> list[list[int]]:
    """Triangles at a node that only one of its tets has."""
    count = Counter(chain.from_iterable(_opposite(cell, node) for cell in cells))
    return [[node, *pair] for pair, own in count.items() if own == 1]
