"""Node pairs of interfaces that need a law with history, and where their traces are.

The diagonal search direction k⁺ has, at every pair, one stiffness along the normal and one across
it. Both sides get the mean of their own k⁻, so that β₁ = β₂ = ½ and keq = k⁺/2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.laws import LAWS
from orchestrator.laws.points import OPEN, Answer, Points
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.model import Interface, Scene
from orchestrator.scene.mesh.patch import node_normals

# Prescribed components are taken out of a normal that keeps this much of its length.
UPRIGHT = 1e-6


@dataclass
class Pairs:
    """All node pairs of a set of interfaces, interface after interface.

    Parameters
    ----------
    interfaces : the interfaces, in order
    bounds : (interfaces + 1,) int, where each one's pairs start
    one, two : (3, P) int, trace dofs (ghosts included) of the pair on side 1 and 2; 0 where prescribed
    free : (3, P) bool, whether the trace dof exists
    points : geometry, search direction and law parameters
    area : (P,) share of the interface's area
    mine : (P,) bool, pairs of interfaces whose first side is on this rank
    tied : (q,) int, this rank's trace dofs that follow the pairs' (see ``ties``), with targets (q, T) and k⁺
        tie_stiffness (q,)
    """

    interfaces: list[Interface]
    bounds: np.ndarray
    one: np.ndarray
    two: np.ndarray
    free: np.ndarray
    points: Points
    area: np.ndarray
    mine: np.ndarray
    tied: np.ndarray
    targets: np.ndarray
    tie_stiffness: np.ndarray

    def __len__(self) -> int:
        return len(self.area)

    def force(self, F: np.ndarray, previous: np.ndarray, derivative: bool = False) -> Answer:
        """The laws' answer for the predicted forces F (3, P), each interface by its own law."""
        parts = [(part, LAWS[law](points, F[:, part], previous[:, part], derivative))
                 for law, part, points in self._runs]
        if not parts:
            return _nothing(derivative)
        if len(parts) == 1 and self._all_free:
            return parts[0][1]
        force = np.where(self.free, np.concatenate([a.force for _, a in parts], axis=1), 0.0)
        answer = Answer(force, np.concatenate([a.status for _, a in parts]))
        if derivative:
            answer.active = np.concatenate([a.active + part.start for part, a in parts])
            free = self.free[:, answer.active]
            slope = np.concatenate([a.derivative for _, a in parts], axis=2)
            answer.derivative = np.where(free[:, None] & free, slope, 0.0)
        return answer

    def some(self, chosen: np.ndarray) -> Pairs:
        """Some of the pairs (Q,) int, ascending, of the same interfaces, without ties."""
        kept = {name: getattr(self, name)[..., chosen] for name in ("one", "two", "free", "area", "mine")}
        return replace(self, points=self.points.some(chosen), bounds=np.searchsorted(chosen, self.bounds),
                       tied=self.tied[:0], targets=self.targets[:0], tie_stiffness=self.tie_stiffness[:0], **kept)

    def idle(self, F: np.ndarray, change: np.ndarray) -> np.ndarray:
        """(P,) bool, pairs that carry no force while the normal part of F changes by at most ``change`` (P,)."""
        return self.force(F - change * self.points.normal, np.zeros_like(F)).status == OPEN

    def gather(self, x: np.ndarray, side: np.ndarray) -> np.ndarray:
        """(…, 3, P) of trace vectors (…, D + G) on one side; zero where prescribed."""
        return self.masked(x.take(side, axis=-1))

    def masked(self, x: np.ndarray) -> np.ndarray:
        """(…, 3, P) values, zero where prescribed."""
        return x if self._all_free else np.where(self.free, x, 0.0)

    def batch(self, steps) -> Pairs:
        """The same pairs for some of the load steps, a slice or indices."""
        return replace(self, targets=self.targets[:, steps])

    @cached_property
    def _all_free(self) -> bool:
        return bool(self.free.all())

    @cached_property
    def _runs(self) -> list[tuple[str, slice, Points]]:
        """Neighbouring interfaces of the same law are worked on as one."""
        laws, runs, start = [i.law for i in self.interfaces], [], 0
        for i, law in enumerate(laws):
            if i + 1 == len(laws) or laws[i + 1] != law:
                part = slice(int(self.bounds[start]), int(self.bounds[i + 1]))
                runs.append((law, part, self.points.some(part)))
                start = i + 1
        return runs


@dataclass
class PairTraces:
    """Traces at the node pairs, of both sides and all load steps, (T, 3, P) each; zero where prescribed."""

    w1: np.ndarray
    w2: np.ndarray
    f1: np.ndarray
    f2: np.ndarray

    @classmethod
    def of(cls, pairs: Pairs, w: np.ndarray, f: np.ndarray) -> PairTraces:
        """From traces (D + G, T)."""
        rows = [np.ascontiguousarray(x.T) for x in (w, f)]
        return cls(*(pairs.gather(x, side) for x in rows for side in (pairs.one, pairs.two)))


def _nothing(derivative: bool) -> Answer:
    """The answer of no pairs."""
    answer = Answer(np.zeros((3, 0)), np.zeros(0, int))
    if derivative:
        answer.active, answer.derivative = np.zeros(0, int), np.zeros((3, 3, 0))
    return answer


def make_pairs(scene: Scene, space: TraceSpace, k: sp.csr_array, wanted: list[Interface]) -> Pairs:
    """Pairs of the wanted interfaces that a rank touches, ordered by law.

    Parameters
    ----------
    k : (D + G, D + G) search direction k⁻, ghosts included
    """
    here = set(space.subdomains)
    wanted = sorted((i for i in wanted if here.intersection(i.subdomains)), key=lambda i: (i.law, i.index))
    one, two, free, normal, area, gap, friction, jump = ([] for _ in range(8))
    for i in wanted:
        sides = np.zeros((2, len(i.global_nodes), 3), dtype=int)
        for side in (0, 1):
            sides[side][i.free] = space.slots[i.index][side]
        points = scene.points(i)
        mobile = i.free.any(axis=1)  # the others are prescribed: nothing is left to a law
        if i.law != "perfect":
            mobile &= np.isin(np.arange(len(mobile)), i.corners)
        n = int(mobile.sum())
        one.append(sides[0][mobile])
        two.append(sides[1][mobile])
        free.append(i.free[mobile])
        upright, length = pair_normals(points, i)
        normal.append(upright[mobile])
        area.append(node_areas(points, i.triangles)[mobile])
        gap.append((i.gap / length)[mobile] if i.gap is not None else np.zeros(n))
        friction.append((i.friction / length)[mobile])
        jump.append(np.broadcast_to(i.jump if i.jump is not None else np.zeros(3), (n, 3)))
    bounds = np.cumsum([0] + [len(x) for x in area])
    mine = np.repeat([i.subdomains[0] in here for i in wanted], np.diff(bounds)).astype(bool)
    none = np.zeros((0, 3))  # a rank may have no such interface
    one, two, free, normal, jump = (np.concatenate([none.astype(t), *x]) for x, t in (
        (one, int), (two, int), (free, bool), (normal, float), (jump, float)))
    area, gap, friction = (np.concatenate([none[:, 0], *x]) for x in (area, gap, friction))
    blocks = 0.5 * (_node_blocks(k, one, free) + _node_blocks(k, two, free))
    # a missing component takes the mean of the others
    trace = np.trace(blocks, axis1=1, axis2=2) * 3 / np.maximum(free.sum(axis=1), 1)
    stiff_n = np.einsum("pi,pij,pj->p", normal, blocks, normal)
    stiff_n = np.where(free.all(axis=1), stiff_n, np.maximum(stiff_n, trace / 3))
    stiff_t = (trace - stiff_n) / 2
    one, two, free, normal, jump = (np.ascontiguousarray(x.T) for x in (one, two, free, normal, jump))
    points = Points(normal, stiff_n / 2, stiff_t / 2, gap, friction, jump)
    ties = (space.ties.dofs, space.ties.targets, space.ties.stiffness) if space.ties else \
        (np.empty(0, int), np.empty((0, scene.steps)), np.empty(0))
    return Pairs(wanted, bounds, one, two, free, points, area, mine, *ties)


def pair_normals(points: np.ndarray, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) from side 1 to side 2 within the components that are free, and the length (n,) left of each.

    What is prescribed on both sides neither opens nor slips: the law lives on the other components, where only
    that part of the pressure is felt, so that gap and friction coefficient grow by 1/length. At the rim of a
    symmetric half the facets' mean normal leans off the plane of symmetry; the true normal does not. Where the
    normal itself is prescribed it stays what it is: nothing presses.
    """
    normal = node_normals(points, interface.triangles) if interface.normals is None else interface.normals
    inside = np.where(interface.free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1)
    length = np.where((length > UPRIGHT) & ~interface.free.all(axis=1), length, 1.0)
    return np.where((length < 1.0)[:, None], inside / length[:, None], normal), length


def node_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) a third of the area of the facets around each corner; none for mid-edge nodes, which are tied."""
    corners = triangles[:, :3]
    area = np.linalg.norm(area_vectors(points, corners), axis=1)
    return np.bincount(corners.ravel(), weights=np.repeat(area / 3, 3), minlength=len(points))


def _node_blocks(k: sp.csr_array, dofs: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P, 3, 3) the 3×3 diagonal blocks of k at the nodes; zero where prescribed."""
    rows = np.repeat(dofs[:, :, None], 3, axis=2)
    columns = np.repeat(dofs[:, None, :], 3, axis=1)
    values = np.asarray(k[rows.ravel(), columns.ravel()]).reshape(-1, 3, 3)
    return np.where(free[:, :, None] & free[:, None, :], values, 0.0)
