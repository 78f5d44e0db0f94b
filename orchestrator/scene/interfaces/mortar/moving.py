"""Sides that are paired anew where they have slid to.

Their faces are known as far as they are smooth, also where nothing is opposite yet. Any slave's
node may carry a point; those that the master does not cover where the sides are now carry none, and
have empty rows: what is numbered stays so, and what points remember stays with them.

Operators of six-node faces whose nodes are paired, under laws that say what passes from the jump or
the force.

A constant traction loads the middles of a six-node face's edges, by a third each, and its corners
not at all. So the points are these middles, node against node, and a corner goes where its body
takes it:

    d = u₂ − u₁ in the middle of an edge,      A n = Σ of the area vectors, a third of each, of the
    faces that meet there

Sums over the middles integrate products of linear functions exactly (Strang & Fix 1973), so that
linear tractions have their resultant and their moment. The jump's mean on every face is that of its
middles, so that what tractions differ from constant ones on a face alone is missed, O(h^(3/2)):
what quadratic displacements reach beside a contact that ends (Hild & Laborde, Appl. Numer. Math.
41, 2002). Means around corners, ∫ N d / ∫ N, would see the gap beyond that border: pressures
oscillate from there inwards. And the pieces of a body that is cut through a contact see the same
gap where they meet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import (
    hats, make_mortar, may_carry, Mortar, only)
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.skins import Skin, smooth_patches
from orchestrator.scene.mesh.geometry import area_vectors, mirrored, node_vectors, unit
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES


@dataclass(frozen=True)
class Moving:
    """Surfaces that an interface is paired anew from.

    surfaces : as they are before loading, whole smooth faces
    free : (n₁, 3), (n₂, 3) bool, components that nothing prescribes
    crossed : (n₁,) bool, slave nodes that other interfaces share
    """

    surfaces: Surfaces
    free: tuple[np.ndarray, np.ndarray]
    crossed: np.ndarray

    @cached_property
    def points(self) -> np.ndarray:
        """(p,) int, ascending, the slave's nodes that may carry a point."""
        carrier = np.zeros(len(self.crossed), dtype=bool)
        carrier[self.surfaces.carriers] = True
        normal = self.surfaces.upright(self.held)
        return np.flatnonzero(carrier & may_carry(self.free[0], self.held, normal, False))

    @cached_property
    def held(self) -> np.ndarray:
        """(n₁, 3) bool, components that are prescribed at a slave's node and somewhere on the
        master: it may come to lie there."""
        return ~self.free[0] & (~self.free[1]).any(axis=0)

    def first(self) -> Mortar:
        """The operators before loading, from what has been found to lie opposite each other
        then.
        """
        return self._embedded(self.surfaces)

    def at(self, moved: tuple[np.ndarray, np.ndarray]) -> Mortar:
        """The operators where the nodes (n₁, 3) and (n₂, 3) of either side have been moved by so
        much.

        Faces of the master are sought within an element of the slave's, in front of it and behind.
        """
        now = replace(self.surfaces,
                      points=tuple(x + u for x, u in zip(self.surfaces.points, moved)))
        reach = self.surfaces.size[now.triangles[0][:, :3]].max(axis=1)
        segments = find_segments(*now.facets, reach)
        under = now.under
        if under is not None:  # surfaces turn as the facets do
            turn = now.facets[0].normal - self.surfaces.facets[0].normal
            under = replace(under[0], normals=unit(under[0].normals + turn[:, None])), under[1]
        return self._embedded(replace(now, segments=segments.nearest(now.area),
                                      resting=self.surfaces.area, under=under))

    def paired(self, now: Mortar, moved: tuple[np.ndarray, np.ndarray]) -> Mortar:
        """Pair anew in the place of the present operators, whose facets and cells behind them stay
        what they are.
        """
        return replace(self.at(moved), triangles=now.triangles, cells=now.cells)

    def _embedded(self, surfaces: Surfaces) -> Mortar:
        mortar = make_mortar(surfaces, self.free, self.crossed, held=self.held)
        all_points, count = self.points, len(self.points)
        place = np.searchsorted(all_points, mortar.points)
        into = sp.csr_array((np.ones(len(place)), (place, np.arange(len(place)))),
                            shape=(count, len(place)))
        blocks = sp.csr_array(sp.kron(into, sp.eye_array(3), format="csr"))
        area, gap = np.zeros(count), self.surfaces.size[all_points]
        normal = surfaces.upright(self.held)[all_points]
        area[place], gap[place], normal[place] = mortar.area, mortar.gap, mortar.normal
        return replace(mortar, points=all_points, first=sp.csr_array(blocks @ mortar.first),
                       second=sp.csr_array(blocks @ mortar.second),
                       area=area, normal=normal, gap=gap, hats=sp.csr_array(mortar.hats @ blocks.T),
                       live=~self.held[all_points])


def whole_faces(skin: Skin, facets: np.ndarray) -> np.ndarray:
    """Facets of a body's skin that make up the smooth faces of some of them."""
    body = skin.body
    label = smooth_patches(body.triangles[:, :3], body.normal, skin.face)
    return np.flatnonzero(np.isin(label, label[facets]))


def paired_mortar(points: np.ndarray, triangles: np.ndarray, cells: np.ndarray,
                  normals: np.ndarray | None, gap: np.ndarray,
                  fixed: tuple[np.ndarray, np.ndarray]) -> Mortar:
    """The operators; parameters as of ``Interface`` and ``Mortar``. What is prescribed on both
    sides has no point.

    points : (n, 3) halfway between the sides
    normals : (n, 3) of a surface at the nodes; None: of the faces; gap : (n,) distance of the sides
        at the nodes
    fixed : (n, 3) bool, components prescribed on either side
    """
    vectors, held = node_vectors(points, triangles, TRIANGLE_SHARES[6]), fixed[0] & fixed[1]
    chosen = np.flatnonzero(vectors.any(axis=1) & ~held.all(axis=1))
    normals = unit(vectors) if normals is None else normals
    upright = mirrored(normals, area_vectors(points, triangles), triangles, held)
    area = np.einsum("ni,ni->n", vectors, upright)
    picks, live = (3 * chosen[:, None] + np.arange(3)).ravel(), ~held[chosen]
    operator = only(sp.csr_array(sp.eye_array(3 * len(points), format="csr")[picks]), live)
    return Mortar(chosen, operator, operator, area[chosen], upright[chosen], gap[chosen], triangles,
                  cells, ~fixed[1],
                  hats(chosen, triangles), live)
