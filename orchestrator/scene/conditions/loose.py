"""Bodies that nothing but contact could hold: boundary conditions leave them a rigid motion."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.conditions.rigid import left_over
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.model import Scene


def loose_bodies(scene: Scene) -> np.ndarray:
    """(subdomains,) bool, those that can move as rigid bodies, together with what joining laws tie to them.

    What contact may do for them depends on the load, and is not looked at: a block that is pressed on another one and
    rubs is loose.
    """
    if scene.overview is not None:
        return scene.overview.loose
    joined = np.array([i.subdomains for i in scene.interfaces if i.law.joins], dtype=int).reshape(-1, 2)
    count, body = components(*joined.T, len(scene.subdomains))
    loose = np.zeros(count, dtype=bool)
    for b in range(count):
        pieces = [scene.subdomains[e] for e in np.flatnonzero(body == b)]
        nodes, place = np.unique(np.concatenate([s.nodes for s in pieces]), return_inverse=True)
        fixed = np.zeros((len(nodes), 3), dtype=bool)
        np.logical_or.at(fixed, place, np.concatenate([s.fixed for s in pieces]))
        loose[b] = left_over(scene.mesh.nodes[nodes], fixed).shape[1] > 0
    return loose[body]
