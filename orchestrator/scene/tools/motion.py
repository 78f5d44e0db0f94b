"""Surfaces of rigid tools, and their motion, each of six prescribed, or free and loaded.

Nodes of a tool move as small motions have it, s + ω × (x − p): a roller's surface slides along
itself and leaves it nowhere. Where the tool's surface is follows from the turn itself. The normal
at a node is the tool's where it comes nearest: under a ball that rolls by, below its middle. With n
out of the part, −∇d, and u the tool's motion as nodes have it, the gap that the law is given at a
load step is

    g = d(x, tool moved) − n·u,      so that     g + n·(u − u_part)

is the distance from the moved tool itself, however far that has gone, but for what the part's own
displacement changes in the normal. What is free of the tool's motion is taken for zero there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.tools import Tool
from orchestrator.registry import GROUND
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.loads.base import Field, Ground, Prescribed
from orchestrator.scene.mesh.geometry import rounding


class ToolSurface(ABC):
    """The surface of a rigid tool.

    middle : (3,) a point that belongs to the tool
    """

    middle: np.ndarray

    @abstractmethod
    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) distances of points (n, 3), negative inside the tool, and (n, 3) unit normals, out
        of the tool.
        """


@dataclass(frozen=True)
class PlaneSurface(ToolSurface):
    """A half-space behind a plane through a point (3,), with a normal (3,) out of it."""

    middle: np.ndarray
    normal: np.ndarray

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (points - self.middle) @ self.normal, np.tile(self.normal, (len(points), 1))


@dataclass(frozen=True)
class Round(ToolSurface):
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


@dataclass(frozen=True)
class SixMotions(Field):
    """The three translations of a point (3,), and the rotations about it by one radian."""

    about: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        return motions_about(points, self.about, 1.0).transpose(2, 0, 1)

    def change(self, amounts: np.ndarray, size: float) -> np.ndarray:
        return np.sqrt(2) * np.linalg.norm(amounts[:, 3:], axis=1) * size


@dataclass(frozen=True)
class Driven(Ground):
    """Motion of a tool at every load step.

    about : (3,) the point that moves, and about which it turns
    prescribed : (6,) bool, which of the motions are, rotations in radians
    moves : (steps, 6) their amounts, 0 where free; loads : (steps, 6) force and moment, 0 where
        prescribed
    """

    about: np.ndarray
    prescribed: np.ndarray
    moves: np.ndarray
    loads: np.ndarray

    whole = True

    @classmethod
    def of(cls, tool: Tool, middle: np.ndarray, factors: Sequence[float]) -> Driven:
        """The motion of the YAML's entry; factors (steps,) multiply it where it lists nothing per
        load step.
        """
        amounts = tool.amounts
        rows = amounts if len(amounts) > 1 else len(factors) * amounts
        factor = np.ones(len(factors)) if len(amounts) > 1 else np.array(factors, dtype=float)
        prescribed = np.array([x is not None for x in rows[0][0]])
        moves = factor[:, None] * np.array([[x or 0.0 for x in move] for move, _ in rows])
        moves[:, 3:] = np.radians(moves[:, 3:])
        loads = factor[:, None] * np.where(prescribed, 0.0,
                                           np.array([load for _, load in rows], dtype=float))
        return cls(middle if tool.about is None else np.array(tool.about), prescribed, moves, loads)

    def laws(self, points: np.ndarray, triangles: np.ndarray) -> list[Any]:
        """Laws of a surface that moves with the tool, as ``Ground`` says."""
        motions = np.ascontiguousarray(motions_about(points, self.about, 1.0).transpose(2, 1, 0))
        return [GROUND["coupling"](motions, self.prescribed, np.where(self.prescribed, move, load),
                                   True, motions)
                for move, load in zip(self.moves, self.loads)]

    @property
    def held(self) -> bool:
        """Whether all of its motions are prescribed."""
        return bool(self.prescribed.all())

    @property
    def told(self) -> Prescribed | Driven:
        """Conditions on the nodes of the tool: displacements where all of its motions are
        prescribed, else itself.
        """
        return Prescribed(np.ones(3, dtype=bool), self.moves,
                          SixMotions(self.about)) if self.held else self

    def displaced(self, points: np.ndarray) -> np.ndarray:
        """(steps, n, 3) how points (n, 3) move with what is prescribed."""
        return np.einsum("tm,mnc->tnc", self.moves, SixMotions(self.about).at(points))


@dataclass(frozen=True)
class Rigid:
    """A tool in its place.

    name : in messages and results
    surface, driven : what it is, and how it moves
    """

    name: str
    surface: ToolSurface
    driven: Driven

    def at(self, move: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances (n,) and normals (n, 3) out of the tool at points (n, 3), where it has moved by
        (6,).
        """
        if not move[3:].any():
            return self.surface.at(points - move[:3])
        from scipy.spatial.transform import Rotation  # for this alone

        turn, about = Rotation.from_rotvec(move[3:]), self.driven.about
        distance, normal = self.surface.at(turn.inv().apply(points - move[:3] - about) + about)
        return distance, turn.apply(normal)

    def gaps(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(steps, n) g at nodes (n, 3), and (n, 3) their unit normals towards the tool."""
        found = [self.at(move, points) for move in self.driven.moves]
        distance, normal = (np.stack(x) for x in zip(*found))
        # the first time
        nearest = (distance <= distance.min(axis=0) + rounding(points, 0.0)).argmax(axis=0)
        n = -normal[nearest, np.arange(len(points))]
        return distance - np.einsum("nc,tnc->tn", n, self.driven.displaced(points)), n
