"""Faces of two bodies that lie on each other, whatever their meshes: found by what they have in common, not by nodes.

Facets face each other where they look at each other, overlap along the normal, and the surfaces that they stand for are
no farther apart than a share of the element size there. The surfaces, not the facets: chords of two polygons about the
same circle are apart, or in each other, by as much as either is off the circle (``skins``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.interfaces.mortar.segments import Segments, find_segments
from orchestrator.scene.interfaces.pairing import OPPOSITE
from orchestrator.scene.interfaces.proximity import TOUCHING, may_face
from orchestrator.scene.interfaces.skins import UNSURE, Skin, over, smooth_patches
from orchestrator.scene.mesh.faces import edge_patches

_NOTHING = Segments(*np.empty((2, 0), dtype=int), *np.empty((2, 0, 6, 3)), *np.empty((2, 0)))
# What two bodies have in common is a pair from this share of the smaller facet there, and if this share of it is sure:
# less is where edges cross.
COMMON = 0.1


@dataclass(frozen=True)
class Facing:
    """A connected patch of faces of two bodies that lie on each other.

    segments : the overlaps, the first body being the slave, in the numbers of the bodies' facets
    area : that both have in common
    size : mean element size of either side
    lowest, mean, highest : distances of the surfaces along the normal, negative inside each other
    sagitta : the farthest that the surfaces of both sides together are off their facets
    """

    segments: Segments
    area: float
    size: tuple[float, float]
    lowest: float
    mean: float
    highest: float
    sagitta: float

    @property
    def facets(self) -> tuple[np.ndarray, np.ndarray]:
        """(k₁,), (k₂,) int, ascending, which facets of either body."""
        return np.unique(self.segments.slave), np.unique(self.segments.master)


def facing(one: Skin, two: Skin, tolerance: float = TOUCHING, within: float | None = None,
           opposite: float = OPPOSITE, wide: bool = False) -> list[Facing]:
    """The patches on which two bodies lie on each other, the one with the first facet first.

    tolerance : how far apart surfaces may be, a share of the smaller element size there, or of the larger where ``wide``
    within : the same as a length, instead
    opposite : the cosine between facets' normals is below this
    """
    a, b, found, sure = _segments(one, two, tolerance, within, opposite, wide)
    if not sure.any():
        return []
    # what is not sure is judged by the smooth face it is on, on either side: beyond a crease begins another one
    for skin, own, side in ((one, a, "slave"), (two, b, "master")):
        used, at = np.unique(getattr(found, side), return_inverse=True)
        chosen = own[used]
        patch = smooth_patches(skin.body.triangles[chosen, :3], skin.body.normal[chosen], skin.face[chosen])[at]
        kept = (np.bincount(patch, found.area * sure) > COMMON * np.bincount(patch, found.area))[patch]
        found, sure = found.some(kept), sure[kept]
        if not len(found):
            return []
    used, at = np.unique(found.slave, return_inverse=True)
    patch = edge_patches(one.body.triangles[a[used], :3])[1][at]
    patches = [_facing(one, two, a, b, found.some(patch == label)) for label in range(int(patch.max()) + 1)]
    return [p for p in patches if p is not None]


def _segments(one: Skin, two: Skin, tolerance: float, within: float | None,
              opposite: float, wide: bool) -> tuple[np.ndarray, np.ndarray, Segments, np.ndarray]:
    """Facets a, b of either body that come near the other, what they may have in common, and where (m,) bool that is sure."""
    x, y = one.body, two.body
    sag = float(two.sagitta.max(initial=0.0))
    size = np.maximum(x.size, y.size.max(initial=0.0)) if wide else x.size
    reach = (tolerance * size if within is None else within) + one.sagitta + sag
    low, high = y.box
    most = float(np.max(reach, initial=0.0))
    a = np.flatnonzero(((x.corners.max(axis=1) >= low - most) & (x.corners.min(axis=1) <= high + most)).all(axis=1))
    low, high = x.box
    b = np.flatnonzero(((y.corners.max(axis=1) >= low - most) & (y.corners.min(axis=1) <= high + most)).all(axis=1))
    if not len(a) or not len(b) or not may_face(x.normal[a], y.normal[b], opposite):
        return a, b, _NOTHING, np.empty(0, dtype=bool)
    found = find_segments(x.corners[a], y.corners[b], reach[a], reach[a], opposite)
    h = (np.maximum if wide else np.minimum)(x.size[a][found.slave], y.size[b][found.master])
    apart = np.abs(_distance(one, two, a, b, found))
    sagitta = one.sagitta[a][found.slave] + two.sagitta[b][found.master]
    over_reach = apart - (tolerance * h if within is None else within)
    near = over_reach <= sagitta
    return a, b, found.some(near), (over_reach <= UNSURE * sagitta)[near]


def _distance(one: Skin, two: Skin, a: np.ndarray, b: np.ndarray, found: Segments) -> np.ndarray:
    """(m,) of the surfaces, in the middle of each overlap."""
    middle = found.on_slave.mean(axis=1), found.on_master.mean(axis=1)
    return (found.distance - over(one.bulge[a[found.slave]], middle[0]) - over(two.bulge[b[found.master]], middle[1]))


def _facing(one: Skin, two: Skin, a: np.ndarray, b: np.ndarray, found: Segments) -> Facing | None:
    """One patch, from all its overlaps; None where edges merely cross."""
    named = found.numbered(a, b)
    mine, theirs = np.unique(named.slave), np.unique(named.master)
    area = float(found.area.sum())
    if area < COMMON * min(one.body.size[mine].min(), two.body.size[theirs].min()) ** 2 / 2:
        return None
    distance = _distance(one, two, a, b, found)
    sagitta = one.sagitta[a[found.slave]] + two.sagitta[b[found.master]]
    return Facing(named, area, (float(one.body.size[mine].mean()), float(two.body.size[theirs].mean())), float(distance.min()),
                  float(found.area @ distance / area), float(distance.max()), float(sagitta.max()))
