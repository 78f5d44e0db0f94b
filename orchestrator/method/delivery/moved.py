"""How far and how much subdomains have moved and turned, beside the size of their bodies: whether perturbations are small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.model import Scene, Subdomain


@dataclass(frozen=True)
class Moved:
    """Of all subdomains of a scene, the largest in any load step; (subdomains,) each."""

    displacement: np.ndarray  # of a component at a node
    rotation: np.ndarray  # radians
    size: np.ndarray  # of the body that each is a piece of: twice the largest distance of a node from the middle of all

    @classmethod
    def of(cls, scene: Scene, own: Sequence[Subdomain], sides: Sequence[np.ndarray], team: Team = ALONE) -> Moved:
        """All ranks ask together.

        own : this rank's subdomains of its part of the scene
        sides : (T, n_E, 3) displacement of each of them
        """
        count, mine, points = len(scene.subdomains), [s.index for s in own], [scene.mesh.nodes[s.nodes] for s in own]
        body = np.unique([s.body for s in scene.subdomains], return_inverse=True)[1].ravel()
        sums, moved = np.zeros((count, 4)), np.zeros((2, count))
        sums[mine] = np.array([[*x.sum(axis=0), len(x)] for x in points]).reshape(-1, 4)
        moved[0, mine], moved[1, mine] = [np.abs(u).max(initial=0.0) for u in sides], rotations(points, sides)
        sums, moved = team.sum(np.stack([np.bincount(body, weights=column) for column in sums.T], axis=1), moved)
        centre, far = sums[:, :3] / np.maximum(sums[:, 3:], 1), np.zeros(len(sums))
        for e, x in zip(mine, points):
            far[body[e]] = max(far[body[e]], np.linalg.norm(x - centre[body[e]], axis=1).max(initial=0.0))
        far = np.array(team.max(*far))
        return cls(moved[0], moved[1], 2 * np.where(far > 0, far, 1.0)[body])


def rotations(points: Sequence[np.ndarray], displacements: Sequence[np.ndarray]) -> np.ndarray:
    """(bodies,) largest rotation, in radians, of the rigid motions that fit displacements (steps, n, 3) of points (n, 3) best."""
    if not points:
        return np.zeros(0)
    counts = np.array([len(p) for p in points])
    starts, member = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
    x, u = np.concatenate(points), np.concatenate(displacements, axis=1)
    arm = x - (np.add.reduceat(x, starts) / counts[:, None])[member]
    products = np.add.reduceat(arm[:, :, None] * arm[:, None], starts)
    inertia = np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(3) - products
    moved = u - (np.add.reduceat(u, starts, axis=1) / counts[:, None])[:, member]
    moment = np.add.reduceat(np.cross(arm, moved), starts, axis=1)
    turned = np.einsum("tei,eij->tej", moment, np.linalg.pinv(inertia))
    return np.linalg.norm(turned, axis=2).max(axis=0, initial=0.0)
