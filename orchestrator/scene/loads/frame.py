"""Cylindrical frames, which components of loads and supports may be along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.errors import KeyPath, Problems
from orchestrator.linalg import PLACED
from orchestrator.scene.mesh.geometry import format_point, unit


@dataclass(frozen=True)
class Cylindrical:
    """Directions about an axis (3,), of length one, through a point (3,)."""

    axis: np.ndarray
    at: np.ndarray

    @classmethod
    def of(cls, frame: Any) -> Cylindrical | None:
        """The value of the YAML's entry; None without one."""
        return None if frame is None else cls(np.array(frame.direction),
                                              np.array(frame.at, dtype=float))

    def directions(self, points: np.ndarray) -> np.ndarray:
        """(…, 3, 3) radial, tangential and axial directions at points (…, 3), as rows; nothing
        radial on the axis.
        """
        arm = points - self.at
        radial = unit(arm - (arm @ self.axis)[..., None] * self.axis)
        return np.stack([radial, np.cross(self.axis, radial),
                         np.broadcast_to(self.axis, radial.shape)], axis=-2)

    def check(self, nodes: np.ndarray, triangles: np.ndarray, path: KeyPath,
              problems: Problems) -> None:
        """Neither nodes nor faces may meet the axis: nothing is radial there.

        nodes : (n, 3); triangles : (k, 3 or 6), the corners first
        """
        if not len(triangles):
            return
        used = np.unique(triangles)
        arm = nodes[used] - self.at
        r = np.linalg.norm(np.cross(arm, self.axis), axis=1)
        if r.min() <= PLACED * (r.max() or 1.0):
            problems.add(path,
                         "a node on the frame's axis, at "
                         f"{format_point(nodes[used[int(r.argmin())]])}, where nothing is radial",
                         "nodes off the axis",
                         "move the frame's axis, or select faces that do not meet it")
            return
        corners = nodes[triangles[:, :3]] - self.at
        turns = np.cross(corners, corners[:, [1, 2, 0]]) @ self.axis  # of each edge about the axis
        pierced = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
        if pierced.any():
            centre = nodes[triangles[np.flatnonzero(pierced)[0], :3]].mean(axis=0)
            problems.add(path,
                         f"a face that the frame's axis runs through, at {format_point(centre)}: "
                         "nothing is radial there",
                         "faces beside the axis",
                         "move the frame's axis, or select faces that do not meet it")
