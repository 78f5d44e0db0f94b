"""Normals at nodes that supports hold in some components, on both sides of an interface.

What both sides have prescribed neither opens nor slips: the law lives on the other components.
"""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.geometry import unit

# What is prescribed is taken out of a normal that keeps this much of its length.
UPRIGHT = 1e-6


def within(normal: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (n, 3) within the components that are free, (n, 3) bool, and the length
    (n,) left of each.

    Only that part of the pressure is felt, so that a gap and a friction coefficient grow by
    1/length. Where the normal itself is prescribed it stays what it is: nothing presses.
    """
    inside = np.where(free, normal, 0.0)
    length = np.linalg.norm(inside, axis=1)
    length = np.where((length > UPRIGHT) & ~free.all(axis=1), length, 1.0)
    return np.where((length < 1.0)[:, None], inside / length[:, None], normal), length


def mirrored(normals: np.ndarray, vectors: np.ndarray, triangles: np.ndarray,
             held: np.ndarray) -> np.ndarray:
    """Return unit normals (n, 3), at planes of symmetry without what the missing half would take
    back.

    At the rim of a symmetric half facets' mean normals lean off the plane by what a curved face
    turns within a facet; the true normal does not. So a component that is held on both sides is
    left out where facets nearby differ in it by as much. On plane faces they do not, nor do they
    where a face runs into a support at an angle.

    vectors : (k, 3) along the facets' normals; held : (n, 3) bool
    """
    if not held.any():
        return normals
    facets = unit(vectors)
    spread = _around(facets, triangles, len(normals)) + _around(-facets, triangles, len(normals))
    inside = np.where(held & (np.abs(normals) <= spread), 0.0, normals)
    length = np.linalg.norm(inside, axis=1, keepdims=True)
    return np.where(length > 0, inside / np.where(length > 0, length, 1.0), normals)


def _around(values: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """(n, c) the largest of values (k, c) of facets that meet a node, or a facet that does."""
    for _ in range(2):
        at = np.full((count, values.shape[1]), -np.inf)
        np.maximum.at(at, triangles.ravel(), np.repeat(values, triangles.shape[1], axis=0))
        values = at[triangles].max(axis=1)
    return at
