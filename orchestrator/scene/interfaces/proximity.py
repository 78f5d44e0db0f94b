"""Parts that are near each other without an interface: faces that lie opposite each other and belong to none.

Faces of either side count whose centre, seen along the mean of the two normals, lies in front of a face of the other
side: a little inside it (rounding, coarse curves) or no farther away than search reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.interfaces.pairing import OPPOSITE, REACH, Body, candidates, in_front

# Closer than this share of the local mesh size, faces touch.
TOUCHING = 0.1
# Normals are compared in steps of this size before faces are: most bodies that are close face each other nowhere.
COARSE = 0.25
_STEPS = round(1 / COARSE)
_KEY = (2 * _STEPS + 1) ** np.arange(2, -1, -1)  # of three numbers of steps, a single one
_DIRECTIONS = (np.indices([2 * _STEPS + 1] * 3).reshape(3, -1).T - _STEPS) * COARSE


@dataclass(frozen=True)
class Near:
    """Faces of two bodies that lie opposite each other.

    count : of the first body's faces; where one of them is
    distance : of the nearest along the normal; negative inside the other
    touching : how many of them touch
    miss : how far corners of those that touch are from the other's nearest corner, at most
    """

    count: int
    where: np.ndarray
    distance: float
    touching: int
    miss: float


def near(one: Body, two: Body, mine: np.ndarray, theirs: np.ndarray) -> Near | None:
    """Faces opposite each other among those (k,) bool of either body that belong to no interface; None: there are none."""
    low, high = np.maximum(one.box[0], two.box[0]), np.minimum(one.box[1], two.box[1])
    low, high = np.minimum(low, high), np.maximum(low, high)
    a, b = one.near(low, high), two.near(low, high)
    a, b = a[mine[a]], b[theirs[b]]
    if not may_face(one.normal[a], two.normal[b]):
        return None
    size = one.size[a]
    # centres of faces in front of each other are no farther apart than that
    i, j = candidates(one.centre[a], two.centre[b], REACH * size + np.maximum(size, two.size[b].max()))
    i, j = a[i], b[j]
    facing = np.einsum("ij,ij->i", one.normal[i], two.normal[j]) < OPPOSITE
    i, j = i[facing], j[facing]
    normal = one.normal[i] - two.normal[j]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x, y = one.centre[i], two.centre[j]
    distance = np.einsum("ij,ij->i", y - x, normal)
    level = (distance <= REACH * one.size[i]) & (distance >= -TOUCHING * one.size[i])
    level &= in_front(x, two.corners[j], -normal) | in_front(y, one.corners[i], normal)
    i, j, distance = i[level], j[level], distance[level]
    if not len(i):
        return None
    touches = distance <= TOUCHING * one.size[i]
    at, worst = (int(np.abs(distance).argmin()), 0.0)
    if touches.any():
        apart = np.linalg.norm(one.corners[i[touches]][:, :, None] - two.corners[j[touches]][:, None], axis=3).min(axis=2)
        each = apart.max(axis=1)
        best = np.full(len(one.corners), np.inf)  # of the faces opposite one, that which fits best
        np.minimum.at(best, i[touches], each)
        worst = float(best[np.isfinite(best)].max())
    return Near(len(np.unique(i)), x[level][at], float(distance[at]), len(np.unique(i[touches])), worst)


def may_face(one: np.ndarray, two: np.ndarray, opposite: float = OPPOSITE) -> bool:
    """Whether any of the normals (n, 3) and (m, 3) may be opposite: the cosine between them below a limit."""
    if not len(one) or not len(two):
        return False
    rounded = [_DIRECTIONS[np.flatnonzero(np.bincount(np.round(normal / COARSE).astype(int) @ _KEY + _KEY.sum() * _STEPS))]
               for normal in (one, two)]
    return bool((rounded[0] @ rounded[1].T < opposite + 2 * COARSE).any())
