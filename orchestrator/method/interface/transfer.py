"""Transfer between the two sides of interfaces: jumps at points, forces of the points on either
side (paper, eq. 5).

With the traces w of all sides in one vector and Q points,

    first(w) = G₁ w,    second(w) = G₂ w,    jump(w) = G₂ w − G₁ w = B w,    opposed(q) = −Bᵀ q

so that a force q on the first side and −q on the second works in the jump alone. Where nodes match,
the points are the common nodes, and every row of G₁ and G₂ has one entry, which is 1. Elsewhere see
``scene.interfaces.mortar`` (dual mortar).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import bounds_of, joined, peak, ratio, times, unit_rows
from orchestrator.scene.interfaces.mortar.operators import Mortar
from orchestrator.scene.interface import Interface

Sides = Sequence[tuple[np.ndarray, np.ndarray]]

# Forces of points are read from mass matrices that condition well: their solutions' far entries
# fade below this.
FADED = 1e-14


class Products(NamedTuple):
    """Sparse operators (Q, D + G) of all points: G₁, G₂, and E, which reads the points' forces, E
    (−Bᵀ) = 1.
    """

    G1: sp.csr_array
    G2: sp.csr_array
    E: sp.csr_array

    @classmethod
    def of_pairs(cls, one: np.ndarray, two: np.ndarray, size: int) -> Products:
        """Transfer of an interface whose nodes match, on the trace dofs of its sides."""
        first, second = unit_rows(one, size), unit_rows(two, size)
        return cls(first, second, 0.5 * (first - second))

    @classmethod
    def of_mortar(cls, mortar: Mortar, one: np.ndarray, two: np.ndarray, size: int) -> Products:
        """Transfer of an interface with points of its own; E is inverseᵀ hatsᵀ of the first side,
        or half of it on either side where their nodes are paired; of the components that there
        are, with empty rows where a point carries nothing now."""
        def on(dofs: np.ndarray, G: sp.csr_array) -> sp.csr_array:
            return sp.csr_array((G.data, dofs[G.indices], G.indptr), shape=(G.shape[0], size))

        read, live = sp.csr_array((mortar.hats @ inverse(mortar)).T), np.flatnonzero(mortar.live)
        forces = 0.5 * (on(one, read) - on(two, read)) if mortar.paired else on(one, read)
        return cls(on(one, mortar.first), on(two, mortar.second), forces).rows(live)

    @classmethod
    def stacked(cls, blocks: Sequence[Products]) -> Products:
        return cls(*(sp.vstack(same) for same in zip(*blocks)))

    def rows(self, chosen: np.ndarray) -> Products:
        """Some of the points by number; −1: one that is not there."""
        chosen = unit_rows(chosen.ravel(), self.G1.shape[0])
        return Products(*(chosen @ G for G in self))


def inverse(mortar: Mortar) -> sp.csr_array:
    """Return (3p, 3p) the inverse of ``mortar.own`` among the components that points carry, with
    empty rows and columns elsewhere.

    On faces of six nodes points meet each other's nodes: on planes of symmetry other points have
    some component than another.
    """
    own = mortar.own
    if mortar.diagonal:
        share = own.diagonal()
        return sp.diags_array(ratio(1, share))
    parts, which = np.unique(mortar.carrying[:, None] & mortar.live, axis=1, return_inverse=True)
    result = sp.csr_array(own.shape)
    for number, part in enumerate(parts.T):
        here, at = which.ravel() == number, np.flatnonzero(part)
        c, there = np.argmax(here), unit_rows(at, len(part))
        dense = np.linalg.inv(own[c::3, c::3][at][:, at].toarray())
        dense[np.abs(dense) < FADED * peak(dense)] = 0.0
        result = result + sp.kron(there.T @ sp.csr_array(dense) @ there, np.diag(here),
                                  format="csr")
    return sp.csr_array(result)


@dataclass(frozen=True)
class Transfer:
    """Transfer between the sides of all interfaces of a scene, or of some."""

    # int array of any shape, here called Q: the trace dof, below D + G, of each point's own node on
    # side 1; −1: there is no such point
    one: np.ndarray
    two: np.ndarray  # the same on side 2 where nodes match, and once more that on side 1 elsewhere
    size: int  # number of trace dofs D, and with ghosts D + G
    total: int
    # (interfaces + 1,) int, where the points of each interface start, along the last axis
    bounds: np.ndarray
    # per interface of the scene, the trace dofs of side 1 and of side 2; empty where neither is
    # this rank's
    sides: Sides
    # (interfaces of the scene,) bool, whose nodes match, and whose law is the perfect one
    matched: np.ndarray
    perfect: np.ndarray
    products: Products  # of these points, flat

    @classmethod
    def of(cls, interfaces: Sequence[Interface], matched: np.ndarray, sides: Sides, size: int,
           total: int) -> Transfer:
        """Transfer of all interfaces of a scene, with a flat point for every component that both
        sides share.

        matched, sides, size, total : as of the class
        """
        perfect = np.array([i.law.perfect for i in interfaces], dtype=bool)
        one = [a if i.mortar is None else a[i.mortar.dofs[i.mortar.live.ravel()]]
               for i, (a, _) in zip(interfaces, sides)]
        two = [b if i.mortar is None else own for i, (_, b), own in zip(interfaces, sides, one)]
        products = Products.of_pairs(joined(one), joined(two),
                                     total) if matched.all() else Products.stacked([
            Products.of_pairs(a, b, total) if i.mortar is None
            else Products.of_mortar(i.mortar, a, b, total)
            for i, (a, b) in zip(interfaces, sides)])
        return cls(joined(one), joined(two), size, total, bounds_of([len(a) for a in one]), sides,
                   matched, perfect, products)

    def paired(self, mortars: dict[int, Mortar]) -> Transfer:
        """The transfer with other operators of some interfaces, of as many points, by their place
        in the scene.
        """
        blocks = [Products(*(G[a:b] for G in self.products))
                  for a, b in zip(self.bounds[:-1], self.bounds[1:])]
        for index, mortar in mortars.items():
            blocks[index] = Products.of_mortar(mortar, *self.sides[index], self.total)
        return replace(self, products=Products.stacked(blocks))

    # ---- fields --------------------------------------------------------------------------------

    def first(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) G₁ of traces (…, D + G)."""
        return self._times(self.products.G1, x)

    def second(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) G₂ of traces (…, D + G)."""
        return self._times(self.products.G2, x)

    def jump(self, x: np.ndarray) -> np.ndarray:
        """(…, Q) second(x) − first(x)."""
        return self._times(self.B, x)

    def carried(self, f: np.ndarray) -> np.ndarray:
        """(…, Q) forces of the points that stand behind forces (…, D + G): the mean of both sides
        where nodes match, else what
        the first side's say, or both where nodes are paired, which is right wherever forces come
        from points."""
        return self._times(self.products.E, f)

    def opposed(self, q: np.ndarray) -> np.ndarray:
        """(…, D + G) −Bᵀ q: forces q (…, Q) on the first sides, −q on the second."""
        return -self._turned(self.B, q)

    def across(self, x: np.ndarray) -> np.ndarray:
        """(…, D) what the other side has there, of traces (…, D + G), where nodes match; zero
        elsewhere.
        """
        return np.where(self._met, x.take(self.partner[: self.size], axis=-1), 0.0)

    def mismatch(self, w: np.ndarray) -> np.ndarray:
        """(…, D) what the sides of traces (…, D + G) are apart: at both nodes of a pair, or √2
        times at a point's own.
        """
        apart = self.across(w) - w[..., : self.size]
        points = self._turned(unit_rows(self.one.ravel(), self.total),
                              np.where(self.at_pairs, 0.0, self.jump(w)))
        return np.where(self._met, apart, np.sqrt(2.0) * points[..., : self.size])

    def imbalance(self, f: np.ndarray) -> np.ndarray:
        """(…, D) what the sides' forces (…, D + G) do not cancel: at both nodes of a pair, or √2
        times on the second side.
        """
        both = f[..., : self.size] + self.across(f)
        return np.where(self._met, both, np.sqrt(2.0)
                        * (f - self.opposed(self.carried(f)))[..., : self.size])

    def _times(self, G: sp.csr_array, x: np.ndarray) -> np.ndarray:
        rows = x.reshape(x[..., 0].size if self.total else 0, self.total)
        return times(G, rows).reshape(*x.shape[:-1], *self.one.shape)

    def _turned(self, G: sp.csr_array, q: np.ndarray) -> np.ndarray:
        leading = q.shape[: q.ndim - self.one.ndim]
        rows = int(np.prod(leading))  # said, since a rank may have no points
        return times(G.T, q.reshape(rows, G.shape[0])).reshape(*leading, self.total)

    # ---- matrices ------------------------------------------------------------------------------

    @property
    def picks(self) -> bool:
        """Whether nodes match on all interfaces of the scene, so that points are nodes."""
        return bool(self.matched.all())

    @cached_property
    def B(self) -> sp.csr_array:
        """(Q, D + G) G₂ − G₁."""
        return self.products.G2 - self.products.G1

    def seen_across(self, matrix: sp.csr_array) -> sp.csr_array:
        """(D, D) a matrix (D + G, D + G) of all sides, as the other sides see it where nodes match;
        zero elsewhere.
        """
        partner, kept = self.partner[: self.size], sp.diags_array(self._met.astype(float))
        return kept @ matrix[partner][:, partner] @ kept

    def at_points(self, matrix: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array]:
        """Q × Q matrices of a matrix (D + G, D + G) that couples no two sides: of side 1 and of
        side 2 where nodes match.

        Elsewhere twice of side 1, whose nodes the points are: a stiffness cannot be carried over
        from other nodes.
        """
        return tuple(matrix[side][:, side] for side in (self.one, self.two))

    def stiffnesses(self, diagonal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q,) what a diagonal stiffness (D + G,) is at the points, on side 1 and on side 2, up to
        a common factor where nodes
        do not match: there, moduli. n nodes on an area A have a sum of about E A/h, h² = A/n."""
        one, two = self.first(diagonal), self.second(diagonal)
        for index in np.flatnonzero(~self.matched):
            points = slice(self.bounds[index], self.bounds[index + 1])
            one[points], two[points] = (diagonal[side].sum() / np.sqrt(max(len(side), 1))
                                        for side in self.sides[index])
        return one, two

    # ---- parts ---------------------------------------------------------------------------------

    @cached_property
    def exists(self) -> np.ndarray:
        """Bool, shape Q: False where a component is prescribed, or a point has slid off, and
        nothing crosses.
        """
        return self.one >= 0

    @cached_property
    def mine(self) -> np.ndarray:
        """Bool, shape Q: points whose first side is on this rank, which adds up what belongs to
        them.
        """
        return (self.one >= 0) & (self.one < self.size)

    @cached_property
    def at_pairs(self) -> np.ndarray:
        """Bool, shape Q: points of interfaces whose nodes match; of all interfaces of the scene."""
        return np.repeat(self.matched, np.diff(self.bounds))

    @cached_property
    def partner(self) -> np.ndarray:
        """(D + G,) int, the trace dof that each one meets; itself where nodes do not match."""
        result, there = np.arange(self.total), self.exists
        result[self.one[there]], result[self.two[there]] = self.two[there], self.one[there]
        return result

    @cached_property
    def _met(self) -> np.ndarray:
        """(D,) bool, whether nodes match there."""
        return self.partner[: self.size] != np.arange(self.size)

    def at(self, row: np.ndarray, bounds: np.ndarray) -> Transfer:
        """Points made of the flat ones that this one has.

        row : int of any shape, which; −1: there is none
        bounds : where the points of each interface that is meant start, along the last axis
        """
        one, two = (np.append(side, -1)[row] for side in (self.one, self.two))
        return replace(self, one=one, two=two, bounds=bounds, products=self.products.rows(row))

    def some(self, chosen: np.ndarray) -> Transfer:
        """Some of the points along the last axis, ascending."""
        number = np.arange(self.one.size).reshape(self.one.shape)[..., chosen]
        return replace(self, one=self.one[..., chosen], two=self.two[..., chosen],
                       bounds=np.searchsorted(chosen, self.bounds),
                       products=self.products.rows(number))
