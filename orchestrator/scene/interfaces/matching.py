"""Opposite faces of different parts, matched node by node where the parts share no faces.

Two outer faces match when they face each other and each corner of one projects, along the mean of
their normals, onto a corner of the other. Parts that touch with coincident but separately numbered
nodes match under any law; under ``gap: geometry`` the faces may be apart, and how far they are is
the initial gap.

Faces deeper in each other than both bodies are thick lie back to back, with the bodies between: two
plates on each other, each thinner than one looks for gaps, have such faces on either outer side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.linalg import WRITTEN
from orchestrator.scene.interfaces.overlap import Hidden
from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.opposite import (
    COINCIDE, OPPOSITE, REACH, BodyFaces, Triangles, opposite)
from orchestrator.scene.mesh.faces import by_label, edge_patches
from orchestrator.scene.mesh.geometry import unit

# How deep, in h, parts may reach into each other to be noticed.
DEEP = 0.5 * ROUND
# Corners that are apart may miss each other sideways by this share of their distance: normals turn.
ASIDE = 0.3
# The three ways in which corners of two opposite triangles, then the middles of their edges, can
# belong together.
TURNS = np.array([[0, 2, 1, 5, 4, 3], [2, 1, 0, 4, 3, 5], [1, 0, 2, 3, 5, 4]])


@dataclass(frozen=True)
class Patch:
    """Matching faces connected through edges.

    facets : (k, 2) int, of either body
    triangles : (k, 3 or 6) int, global nodes of the first side, outward; opposite : the same shape,
        their partners
    cells : (k, 2) int, the tets behind them
    """

    facets: np.ndarray
    triangles: np.ndarray
    opposite: np.ndarray
    cells: np.ndarray


def match(one: BodyFaces, two: BodyFaces, apart: bool = False, within: float | None = None,
          share: float = REACH,
          hidden: Hidden | None = None) -> list[Patch]:
    """Patches of matching faces of two bodies.

    apart : whether they may be at a distance; otherwise nodes must coincide
    within : search distance; none: ``share`` × h, of the larger facet of two
    hidden : whether another body is between two facets that are apart; none: nothing is
    """
    size = one.size
    reach = COINCIDE * size if not apart else np.full(len(size),
                                                      within) if within else share * np.maximum(
                                                          size, two.size.max())
    found = list(opposite(one, two, (1 + ASIDE) * reach, spheres=False))
    if not found:
        return []
    i, j = (np.concatenate(side) for side in zip(*found))
    reach = share * np.maximum(size[i], two.size[j]) if apart and not within else reach[i]
    normal = unit(one.normal[i] - two.normal[j])
    away = two.corners[j][:, TURNS[:, :3]] - one.corners[i][:, None]  # (m, 3 turns, 3 corners, 3)
    along = np.einsum("mtci,mi->mtc", away, normal)
    # (m, 3)
    aside = np.linalg.norm(away - along[..., None] * normal[:, None, None, :], axis=3).max(axis=2)
    turn, rows = aside.argmin(axis=1), np.arange(len(i))
    aside, distance = aside[rows, turn], along[rows, turn].mean(axis=1)
    limit, depth = (np.maximum(COINCIDE * size[i], ASIDE * np.abs(distance)),
                    DEEP * size[i]) if apart else (reach, reach)
    fits = np.flatnonzero((distance <= reach) & (distance >= -depth) & (aside <= limit))
    if apart:
        fits = fits[~back_to_back(one, two, i[fits], j[fits],
                                  np.where(distance < -COINCIDE * size[i], -distance, 0.0)[fits])]
    if apart and hidden is not None:
        middle = np.full((len(fits), 3), 1 / 3)
        fits = fits[~hidden(i[fits], middle, j[fits], middle, distance[fits])]
    # of several partners the nearest; then one node for one node
    order = fits[np.lexsort((aside[fits], np.abs(distance[fits])))]
    keep = np.sort(order[np.unique(i[order], return_index=True)[1]])
    i, j, turn = i[keep], j[keep], turn[keep]
    partners = two.triangles[j[:, None], TURNS[turn, : two.triangles.shape[1]]]
    single = _one_to_one(one.triangles[i], partners)
    facets, partners = np.c_[i, j][single], partners[single]
    triangles, cells = one.triangles[facets[:, 0]], np.c_[one.cells[facets[:, 0]],
                                                          two.cells[facets[:, 1]]]
    return [Patch(facets[p], triangles[p], partners[p], cells[p])
            for p in by_label(edge_patches(triangles)[1])]


def _one_to_one(triangles: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """(k,) bool, faces none of whose nodes has a second partner."""
    pairs = np.unique(np.c_[triangles.ravel(), opposite.ravel()], axis=0)
    single = np.ones(len(triangles), dtype=bool)
    for nodes, side in zip(pairs.T, (triangles, opposite)):
        found, count = np.unique(nodes, return_counts=True)
        single &= ~np.isin(side, found[count > 1]).any(axis=1)
    return single


def back_to_back(one: Triangles, two: Triangles, i: np.ndarray, j: np.ndarray,
                 depth: np.ndarray) -> np.ndarray:
    """(m,) bool, whether both bodies are between facets i and j.

    depth : (m,) by which they are in each other; 0 or less where they are not
    """
    result = np.zeros(len(i), dtype=bool)
    inside = np.flatnonzero(depth > 0)
    if len(inside):
        result[inside] = True
        for body, own in ((one, i[inside]), (two, j[inside])):
            result[inside] &= depth[inside] >= (1 - WRITTEN) * _thickness(body, own, depth[inside])
    return result


def _thickness(body: Triangles, own: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(m,) how thick a body is behind its facets (m,) int, infinite where that is more than
    ``most`` (m,).
    """
    facets, at = np.unique(own, return_inverse=True)
    reach = np.zeros(len(facets))
    np.maximum.at(reach, at, ROUND * most)
    found = find_segments(body.some(facets), body, reach, OPPOSITE)
    result = np.full(len(facets), np.inf)
    np.minimum.at(result, found.slave, np.where(found.distance < 0, -found.distance, np.inf))
    return result[at]
