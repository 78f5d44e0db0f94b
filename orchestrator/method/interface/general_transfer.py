"""Transfer where the nodes of some interface do not match: sparse G₁ and G₂ (dual mortar, see ``scene.interfaces.mortar``).

What is said of ``Matching`` holds here, with products in the place of index arrays. A force q of the points is
f₁ = G₁ᵀ q on the first side; the other way round ``carried`` reads q from the forces of the first side alone, which is
right wherever forces come from points. Interfaces whose nodes match are among the others, with rows of one entry; for
what only they can do, an exchange, ``matching`` has their index arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.mortar_rows import of_mortar, picks
from orchestrator.method.interface.rows import times
from orchestrator.method.interface.transfer import Matching
from orchestrator.scene.interfaces.mortar.operators import Mortar
from orchestrator.scene.model import Interface


@dataclass(frozen=True)
class General:
    """Transfer between sides of which some have other meshes.

    Parameters
    ----------
    G1, G2 : (Q, D + G) sparse; rows of points without a component are empty
    E : (Q, D + G) sparse, reads the forces of points from those of the first side: E G₁ᵀ = 1
    own : (Q,) int, the trace dof of each point's own node on the first side; −1 where there is none
    shape : of the points, (Q,) or (3, P); operators have them flat
    size, total : number of trace dofs D, and with ghosts D + G
    bounds : (interfaces + 1,) int, where the points of each interface of the scene start, along the last axis
    sides : per interface of the scene, the trace dofs of side 1 and of side 2
    matched : (interfaces,) bool, whose nodes match
    matching : their trace dofs, flat, those of the other interfaces left out
    exists : bool, shape of the points; False where nothing crosses. None: all are there
    """

    G1: sp.csr_array
    G2: sp.csr_array
    E: sp.csr_array
    own: np.ndarray
    shape: tuple[int, ...]
    size: int
    total: int
    bounds: np.ndarray
    sides: Sequence[tuple[np.ndarray, np.ndarray]]
    matched: np.ndarray
    matching: Matching
    exists: np.ndarray | None = None

    @classmethod
    def of(cls, interfaces: Sequence[Interface], sides: Sequence[tuple[np.ndarray, np.ndarray]], size: int) -> General:
        """Of all interfaces of a scene, with the trace dofs of side 1 and of side 2 of each; points are flat."""
        blocks, none = [], np.empty(0, int)
        own = [none]
        for interface, (one, two) in zip(interfaces, sides):
            if interface.mortar is None:
                first, second = picks(one, size), picks(two, size)
                blocks.append((first, second, first))
                own.append(one)
            else:
                blocks.append(of_mortar(interface.mortar, one, two, size))
                own.append(one[interface.mortar.dofs])
        joined = [sp.csr_array(sp.vstack(same)) if blocks else sp.csr_array((0, size)) for same in zip(*blocks)] or \
            [sp.csr_array((0, size))] * 3
        bounds = np.cumsum([0] + [b[0].shape[0] for b in blocks])
        matched = np.array([i.mortar is None for i in interfaces], dtype=bool)
        matching = Matching.of([pair if m else (none, none) for pair, m in zip(sides, matched)], size)
        return cls(*joined, np.concatenate(own), (int(bounds[-1]),), size, size, bounds, list(sides), matched, matching)

    def paired(self, mortars: dict[int, Mortar]) -> General:
        """The same with other operators of some interfaces, of as many points, by their place in the scene."""
        blocks = [[G[a:b] for a, b in zip(self.bounds[:-1], self.bounds[1:])] for G in (self.G1, self.G2, self.E)]
        for index, mortar in mortars.items():
            for place, block in zip(blocks, of_mortar(mortar, *self.sides[index], self.total)):
                place[index] = block
        G1, G2, E = (sp.csr_array(sp.vstack(same)) for same in blocks)
        return replace(self, G1=G1, G2=G2, E=E)

    # ---- fields --------------------------------------------------------------------------------

    def first(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) G₁ of traces (…, D + G)."""
        return self._times(self.G1, x)

    def second(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) G₂ of traces (…, D + G)."""
        return self._times(self.G2, x)

    def jump(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) second(x) − first(x)."""
        return self._times(self.B, x)

    def carried(self, f: np.ndarray) -> np.ndarray:
        """(…, Q) forces of the points that stand behind forces (…, D + G) of the first sides."""
        return self._times(self.E, f)

    def spread(self, one: np.ndarray, two: np.ndarray) -> np.ndarray:
        """(…, D + G) G₁ᵀ one + G₂ᵀ two of values (…, Q)."""
        return self._turned(self.G1, one) + self._turned(self.G2, two)

    def opposed(self, q: np.ndarray) -> np.ndarray:
        """(…, D + G) −Bᵀ q: forces q (…, Q) on the first sides, −q on the second."""
        return -self._turned(self.B, q)

    def across(self, x: np.ndarray) -> np.ndarray:
        """(…, D) what the other side has there, where nodes match; zero elsewhere."""
        return np.where(self._met, x.take(self._partner, axis=-1), 0.0)

    def mismatch(self, w: np.ndarray) -> np.ndarray:
        """(…, D) what the sides of traces (…, D + G) are apart: at both nodes of a pair, or √2 times at a point's own."""
        points = self._turned(self.own_nodes, np.where(self._general, self._flat(self.jump(w)), 0.0), flat=True)[..., : self.size]
        return np.where(self._met, self.across(w) - w[..., : self.size], np.sqrt(2.0) * points)

    def imbalance(self, f: np.ndarray) -> np.ndarray:
        """(…, D) what the sides' forces (…, D + G) do not cancel: at both nodes of a pair, or √2 times on the master."""
        left = f + self._turned(self.B, self._flat(self.carried(f)), flat=True)
        return np.where(self._met, self.across(f) + f[..., : self.size], np.sqrt(2.0) * left[..., : self.size])

    def opposed_traces(self, w: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of ``Matching``."""
        return (np.arange(self.size), w[..., : self.size] + self.mismatch(w), self.imbalance(f) - f[..., : self.size])

    # ---- matrices ------------------------------------------------------------------------------

    def seen_across(self, matrix: sp.csr_array) -> sp.csr_array:
        """(D, D) a matrix (D + G, D + G) of all sides, as the other sides see it where nodes match; zero elsewhere."""
        kept = sp.diags_array(self._met.astype(float))
        return sp.csr_array(kept @ matrix[self._partner][:, self._partner] @ kept)

    def rows(self, fields: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """Q × m of sparse columns (D + G, m), on side 1 and on side 2."""
        return sp.csr_array(self.G1 @ fields), sp.csr_array(self.G2 @ fields)

    def at_points(self, matrix: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """Q × Q matrices of a matrix (D + G, D + G) that couples no two sides: of side 1 and of side 2 where nodes match.

        Elsewhere twice of side 1, whose nodes the points are: a stiffness cannot be carried over from other nodes.
        """
        one = sp.csr_array(self.own_nodes @ matrix @ self.own_nodes.T)
        matched = sp.diags_array((~self._general).astype(float))
        rest = sp.diags_array(self._general.astype(float))
        two = sp.csr_array(matched @ (self.G2 @ matrix @ self.G2.T) @ matched)
        return one, sp.csr_array(two + rest @ one @ rest)

    def both_sides(self, bases: Sequence[np.ndarray], signs: tuple[float, float]) -> sp.csr_array:
        """(D, sum of m) forces of every interface's points, (points, m) each, on both sides with a sign for each.

        Interfaces without points here keep their columns.
        """
        fields = self._beside(bases)
        return sp.csr_array((signs[0] * self.G1.T @ fields + signs[1] * self.G2.T @ fields)[: self.size])

    def displacements(self, bases: Sequence[np.ndarray]) -> sp.csr_array:
        """(D, sum of m) fields of every interface without any jump: (points, m) each, the same on both sides where nodes
        match, elsewhere (trace dofs of side 1 and of side 2, m)."""
        widths = np.array([b.shape[1] for b in bases], dtype=int)
        starts = np.cumsum(widths) - widths
        result = self.matching.both_sides([b if m else b[:0] for b, m in zip(bases, self.matched)], (1.0, 1.0))
        for index in np.flatnonzero(~self.matched):
            dofs = np.concatenate(self.sides[index])
            if len(dofs):
                rows, columns = np.meshgrid(dofs, starts[index] + np.arange(widths[index]), indexing="ij")
                own = rows < self.size
                result = result + sp.csr_array((bases[index][own], (rows[own], columns[own])), shape=result.shape)
        return sp.csr_array(result)

    def on_points(self, bases: Sequence[np.ndarray]) -> sp.csr_array:
        """(Q, sum of m) the fields of ``displacements`` at the points."""
        return self._beside([b if m else self.G1[a:e][:, one] @ b[: len(one)] for b, m, a, e, (one, _) in zip(
            bases, self.matched, self.bounds[:-1], self.bounds[1:], self.sides)])

    def _beside(self, bases: Sequence[np.ndarray]) -> sp.csr_array:
        """(Q, sum of m) fields (points, m) of every interface, on its own points and in columns of its own."""
        if not len(bases):
            return sp.csr_array((0, 0))
        return sp.block_diag([sp.csr_array(b if n else b[:0]) for b, n in zip(bases, np.diff(self.bounds))], format="csr")

    # ---- parts ---------------------------------------------------------------------------------

    def opposite(self, dofs: np.ndarray) -> np.ndarray:
        """Trace dofs, ascending, that meet some of the given ones; where nodes do not match, whole sides do."""
        chosen = np.zeros(self.total, bool)
        chosen[dofs] = True
        found = [self.matching.opposite(dofs)]
        for index in np.flatnonzero(~self.matched):
            one, two = self.sides[index]
            found += [two] * bool(chosen[one].any()) + [one] * bool(chosen[two].any())
        return np.unique(np.concatenate(found))

    def renumbered(self, place: np.ndarray, size: int, total: int) -> General:
        """The points that have both sides in another numbering, as for ``Matching``."""
        kept, known = [], place >= 0
        for index, (one, two) in enumerate(self.sides):
            points = np.arange(self.bounds[index], self.bounds[index + 1])
            if self.matched[index]:
                kept.append(points[known[one] & known[two]])
            else:
                kept.append(points if known[one].all() and known[two].all() else points[:0])
        rows = np.concatenate([np.empty(0, int), *kept])
        columns = np.zeros(total, int)
        columns[place[known]] = np.flatnonzero(known)
        G1, G2, E = (sp.csr_array(G[rows][:, columns]) for G in (self.G1, self.G2, self.E))
        none = np.empty(0, int)
        sides = [(place[a], place[b]) if known[a].all() and known[b].all() else (none, none) for a, b in self.sides]
        return General(G1, G2, E, place[self.own[rows]], (len(rows),), size, total, np.cumsum([0] + [len(k) for k in kept]), sides, self.matched,
                       self.matching.renumbered(place, size, total))

    def at(self, rows: np.ndarray, bounds: np.ndarray) -> General:
        """Points (3, P) made of flat ones.

        Parameters
        ----------
        rows : (3, P) int, which; −1: there is none
        bounds : where the points of each interface of the scene that is meant start, along the last axis
        """
        there = sp.csr_array((np.ones((rows >= 0).sum()), (np.flatnonzero(rows.ravel() >= 0), rows[rows >= 0])),
                             shape=(rows.size, self.G1.shape[0]))
        G1, G2, E = (sp.csr_array(there @ G) for G in (self.G1, self.G2, self.E))
        own = np.where(rows >= 0, self.own[rows], -1).ravel()
        return replace(self, G1=G1, G2=G2, E=E, own=own, shape=rows.shape, bounds=bounds, exists=rows >= 0)

    def some(self, chosen: np.ndarray) -> General:
        """Some of the points along the last axis, ascending."""
        rows = np.arange(np.prod(self.shape, dtype=int)).reshape(self.shape)[..., chosen]
        G1, G2, E = (sp.csr_array(G[rows.ravel()]) for G in (self.G1, self.G2, self.E))
        return replace(self, G1=G1, G2=G2, E=E, own=self.own[rows.ravel()], shape=rows.shape,
                       bounds=np.searchsorted(chosen, self.bounds),
                       exists=None if self.exists is None else self.exists[..., chosen])

    def stiffnesses(self, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q,) what a diagonal stiffness (D + G,) is at the points, on side 1 and on side 2, up to a common factor where nodes
        do not match: there, moduli. n nodes on an area A have a sum of about E A/h, h² = A/n."""
        one, two = self.first(diagonal), self.second(diagonal)
        for index in np.flatnonzero(~self.matched):
            points = slice(self.bounds[index], self.bounds[index + 1])
            one[points], two[points] = (diagonal[side].sum() / np.sqrt(max(len(side), 1)) for side in self.sides[index])
        return one, two

    def matches(self, index: int) -> bool:
        """Whether the nodes of an interface of the scene match."""
        return bool(self.matched[index])

    @cached_property
    def B(self) -> sp.csr_array:
        """(Q, D + G) G₂ − G₁."""
        return sp.csr_array(self.G2 - self.G1)

    @cached_property
    def own_nodes(self) -> sp.csr_array:
        """(Q, D + G) 0/1: the points' own dofs on the first side."""
        there = np.flatnonzero(self.own >= 0)
        return sp.csr_array((np.ones(len(there)), (there, self.own[there])), shape=self.G1.shape)

    @cached_property
    def mine(self) -> np.ndarray:
        """(Q,) bool, points whose first side is on this rank; flat points only."""
        return (self.own >= 0) & (self.own < self.size)

    @cached_property
    def _general(self) -> np.ndarray:
        """(Q flat,) bool, points of interfaces whose nodes do not match."""
        return np.broadcast_to(np.repeat(~self.matched, np.diff(self.bounds)), self.shape).ravel()

    @cached_property
    def _partner(self) -> np.ndarray:
        """(D,) int, the trace dof that each one meets; itself where nodes do not match."""
        result = np.arange(self.total)
        one, two = self.matching.one, self.matching.two
        result[one], result[two] = two, one
        return result[: self.size]

    @cached_property
    def _met(self) -> np.ndarray:
        """(D,) bool, whether there is one."""
        return self._partner != np.arange(self.size)

    def _flat(self, x: np.ndarray) -> np.ndarray:
        return x.reshape(*x.shape[: x.ndim - len(self.shape)], -1)

    def _times(self, G: sp.csr_array, x: np.ndarray) -> np.ndarray:
        return times(G, x.reshape(-1, self.total)).reshape(*x.shape[:-1], *self.shape)

    def _turned(self, G: sp.csr_array, q: np.ndarray, flat: bool = False) -> np.ndarray:
        q = q if flat else self._flat(q)
        rows = int(np.prod(q.shape[:-1]))  # said, since a rank may have no points
        return times(G.T, q.reshape(rows, G.shape[0])).reshape(*q.shape[:-1], self.total)


def make_transfer(interfaces: Sequence[Interface], sides: Sequence[tuple[np.ndarray, np.ndarray]],
                  size: int) -> Matching | General:
    """Index arrays where the nodes of all interfaces match, products elsewhere."""
    if all(interface.mortar is None for interface in interfaces):
        return Matching.of(sides, size)
    return General.of(interfaces, sides, size)
