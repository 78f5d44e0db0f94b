"""Surfaces of rigid tools: how far points are from them, and along which normal."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np


class Surface(ABC):
    """The surface of a rigid tool.

    middle : (3,) a point that belongs to the tool
    """

    middle: np.ndarray

    @abstractmethod
    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) distances of points (n, 3), negative inside the tool, and (n, 3) unit normals, out of the tool."""


@dataclass(frozen=True)
class Plane(Surface):
    """A half-space behind a plane through a point (3,), with a normal (3,) out of it."""

    middle: np.ndarray
    normal: np.ndarray

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (points - self.middle) @ self.normal, np.tile(self.normal, (len(points), 1))


@dataclass(frozen=True)
class Round(Surface):
    """A sphere about a point (3,), or a cylinder about an axis (3,), of length one, through it.

    hollow : whether the tool is outside
    """

    middle: np.ndarray
    radius: float
    hollow: bool
    axis: np.ndarray | None = None

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arm = points - self.middle
        if self.axis is not None:
            arm = arm - np.outer(arm @ self.axis, self.axis)
        length = np.linalg.norm(arm, axis=1)
        out = -1.0 if self.hollow else 1.0
        return out * (length - self.radius), out * arm / np.where(length > 0, length, 1.0)[:, None]
