"""What curved surfaces fill of the gap between the facets that stand for them."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.interfaces.mortar.duals import multipliers
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces


def filled(surfaces: Surfaces) -> np.ndarray:
    """(n₁,) what the surfaces of both sides fill of the gap between facets, averaged with the multipliers of the slave's nodes;
    negative where they are farther apart than the facets."""
    count = len(surfaces.points[0])
    if surfaces.under is None or not any(side.bulge.any() for side in surfaces.under):
        return np.zeros(count)
    # the bulges are quadratic functions: of nodes of its own amid each facet's edges
    nodes, ends, values = [], [], []
    for points, triangles, side in zip(surfaces.points, surfaces.triangles, surfaces.under):
        middles = len(points) + np.arange(side.bulge.size).reshape(side.bulge.shape)
        nodes.append(np.hstack([triangles[:, :3], middles]))
        ends.append(len(points) + side.bulge.size)
        values.append(np.concatenate([np.zeros(len(points)), side.bulge.ravel()]))
    weights = multipliers(surfaces.segments, *nodes, surfaces.area, tuple(ends), dual=surfaces.triangles[0].shape[1] == 3)
    return ((weights.own @ values[0] + weights.other @ values[1]) / np.where(weights.area > 0, weights.area, 1.0))[:count]
