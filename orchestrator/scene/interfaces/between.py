"""Bodies between faces that look at each other: no pair reaches through another body."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from orchestrator.rounding import PLACED
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.opposite import COINCIDE, BodyFaces, Triangles
from orchestrator.scene.interfaces.skins import Skin, over
from orchestrator.scene.mesh.faces import runs
from orchestrator.scene.mesh.geometry import rounding


# Of facets i of one body and j of another, at barycentric coordinates (m, 3) of either, and what
# is between their planes there (m,), a length: (m,) bool, whether another body is there.
Hidden = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def hidden(bodies: Sequence[BodyFaces], skins: Callable[[BodyFaces], Skin], one: BodyFaces,
           two: BodyFaces) -> Hidden:
    """Return the test whether a third of the ``bodies`` is between two: it has a face that looks
    at the first one's, on the way along the normal, and nearer than the second one's. Distances
    are those of the surfaces that facets stand for."""

    def test(i: np.ndarray, at: np.ndarray, j: np.ndarray, at_two: np.ndarray,
             distance: np.ndarray) -> np.ndarray:
        result = np.zeros(len(i), dtype=bool)
        mine, theirs = skins(one).surface, skins(two).surface
        bulge = over(mine.bulge[i], at)
        distance = distance - bulge - over(theirs.bulge[j], at_two)
        points = np.einsum("mk,mkc->mc", at, one.corners[i])
        least = rounding(points, PLACED * one.size[i]) + mine.unsure[i] + theirs.unsure[j]
        apart = np.flatnonzero(distance > least)
        if not len(apart):
            return result
        box, room = (points[apart].min(axis=0), points[apart].max(axis=0)), distance[apart].max()
        for third in bodies:
            near = third.within(box, room) if third is not one and third is not two else ()
            if len(near):
                surface = skins(third).surface.some(near)
                behind = COINCIDE * one.size[i] + mine.sagitta[i]
                result[apart] |= _met(one, i[apart], at[apart], third.some(near), surface.bulge,
                                      bulge[apart], behind[apart], (distance - least)[apart])
        return result

    return test


def _met(one: Triangles, i: np.ndarray, at: np.ndarray, third: Triangles, theirs: np.ndarray,
         bulge: np.ndarray, behind: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return (m,) bool, whether rays along normals meet a body's facets before a distance (m,).

    The rays begin on facets i (m,) at barycentric coordinates (m, 3), over which their surface
    bulges by (m,); ``behind`` (m,) it the other's surface may be. ``theirs`` : (k, 3) its bulges.
    """
    facets, place = np.unique(i, return_inverse=True)
    reach, off = np.zeros(len(facets)), np.abs(theirs).max(axis=1)
    np.maximum.at(reach, place, distance + behind + off.max())
    found = find_segments(one.some(facets), third, reach)
    count = np.bincount(found.slave, minlength=len(facets))
    many = count[place]  # each ray with all facets that overlap its own
    ray, which = np.repeat(np.arange(len(i)), many), runs((np.cumsum(count) - count)[place], many)
    facet, normal = found.master[which], one.normal[i[ray]]
    point = np.einsum("mk,mkc->mc", at[ray], one.corners[i[ray]])
    corner, across = third.corners[facet, 0], third.normal[facet]
    way = np.einsum("mc,mc->m", corner - point, across) / np.einsum("mc,mc->m", normal, across)
    met = np.einsum("mc,mkc->mk", point + way[:, None] * normal - corner, third.slopes[facet])
    met[:, 0] += 1.0
    way = way - bulge[ray] - over(theirs[facet], met)
    before = (met > -PLACED).all(axis=1) & (way >= -behind[ray] - off[facet]) & (
        way < distance[ray])
    return np.bincount(ray[before], minlength=len(i)) > 0
