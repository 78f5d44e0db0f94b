"""How thick bodies are behind their faces: faces deeper in each other than both bodies are thick lie back to back, with the bodies between.

Two plates on each other, each thinner than one looks for gaps, have such faces on either outer side.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.interfaces.mortar.segments import find_segments
from orchestrator.scene.interfaces.opposite import OPPOSITE, Facets

ROUNDED = 1e-6  # of a thickness


def back_to_back(one: Facets, two: Facets, i: np.ndarray, j: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(m,) bool, whether both bodies are between facets i and j.

    depth : (m,) by which they are in each other; 0 or less where they are not
    """
    result = np.zeros(len(i), dtype=bool)
    inside = np.flatnonzero(depth > 0)
    if len(inside):
        result[inside] = True
        for body, own in ((one, i[inside]), (two, j[inside])):
            result[inside] &= depth[inside] >= (1 - ROUNDED) * _thickness(body, own, depth[inside])
    return result


def _thickness(body: Facets, own: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(m,) how thick a body is behind its facets (m,) int, infinite where that is more than ``most`` (m,)."""
    facets, at = np.unique(own, return_inverse=True)
    reach = np.zeros(len(facets))
    np.maximum.at(reach, at, most)
    found = find_segments(body.some(facets), body, reach, OPPOSITE)
    result = np.full(len(facets), np.inf)
    np.minimum.at(result, found.slave, np.where(found.distance < 0, -found.distance, np.inf))
    return result[at]
