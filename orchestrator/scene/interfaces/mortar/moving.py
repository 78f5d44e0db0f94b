"""Sides that are paired anew where they have slid to.

Their faces are known as far as they are smooth, also where nothing is opposite yet. Any slave's node may carry a point; those
that the master does not cover where the sides are now carry none, and have empty rows: what is numbered stays so, and what
points remember stays with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar, make_mortar, may_carry
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.skins import Skin, smooth_patches
from orchestrator.scene.mesh.geometry import local_size


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

    @cached_property
    def size(self) -> np.ndarray:
        """(n₁,) local element size of the slave."""
        return local_size(self.surfaces.points[0], self.surfaces.triangles[0])

    def first(self) -> Mortar:
        """The operators before loading, from what has been found to lie opposite each other then."""
        return self._embedded(self.surfaces)

    def at(self, moved: tuple[np.ndarray, np.ndarray]) -> Mortar:
        """The operators where the nodes (n₁, 3) and (n₂, 3) of either side have been moved by so much.

        Faces of the master are sought within an element of the slave's, in front of it and behind.
        """
        now = replace(self.surfaces, points=tuple(x + u for x, u in zip(self.surfaces.points, moved)))
        segments = find_segments(*now.facets, self.size[now.triangles[0][:, :3]].max(axis=1))
        under = now.under
        if under is not None:  # surfaces turn as the facets do
            turn = now.facets[0].normal - self.surfaces.facets[0].normal
            normals = under[0].normals + turn[:, None]
            under = replace(under[0], normals=normals / np.linalg.norm(normals, axis=2, keepdims=True)), under[1]
        return self._embedded(replace(now, segments=segments.nearest(now.area), resting=self.surfaces.area, under=under))

    def paired(self, now: Mortar, moved: tuple[np.ndarray, np.ndarray]) -> Mortar:
        """Pair anew in the place of the present operators, whose facets and cells behind them stay what they are."""
        return replace(self.at(moved), triangles=now.triangles, cells=now.cells)

    def _embedded(self, surfaces: Surfaces) -> Mortar:
        mortar = make_mortar(surfaces, self.free, self.crossed, held=self.held)
        all_points, count = self.points, len(self.points)
        place = np.searchsorted(all_points, mortar.points)
        into = sp.csr_array((np.ones(len(place)), (place, np.arange(len(place)))), shape=(count, len(place)))
        blocks = sp.csr_array(sp.kron(into, sp.eye_array(3), format="csr"))
        area, gap = np.zeros(count), self.size[all_points]
        normal = surfaces.upright(self.held)[all_points]
        area[place], gap[place], normal[place] = mortar.area, mortar.gap, mortar.normal
        return replace(mortar, points=all_points, first=sp.csr_array(blocks @ mortar.first), second=sp.csr_array(blocks @ mortar.second),
                       area=area, normal=normal, gap=gap, hats=sp.csr_array(mortar.hats @ blocks.T),
                       live=~self.held[all_points])


def whole_faces(skin: Skin, facets: np.ndarray) -> np.ndarray:
    """Facets of a body's skin that make up the smooth faces of some of them."""
    body = skin.body
    label = smooth_patches(body.triangles[:, :3], body.normal, skin.face)
    return np.flatnonzero(np.isin(label, label[facets]))
