"""``motion``: a rigid motion that is prescribed, u = s + ω × (x − p)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field as Key

from orchestrator.config.base import Part, Rotate, Vector, unit
from orchestrator.scene.loads.base import Field, Kind, OnFaces, Prescribed


class Motion(Part):
    """A rigid motion: a shift, and a turn that is small."""

    translate: Vector = Key([0.0, 0.0, 0.0], description="the shift of points on the turn's axis")
    rotate: Rotate | None = Key(None, description="{axis, degrees, about}; none: no turn")


@dataclass(frozen=True)
class Rigid(Field):
    """A shift (3,), and a small turn (3,), in radians, about a point (3,)."""

    shift: np.ndarray
    turn: np.ndarray
    about: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        return (self.shift + np.cross(self.turn, points - self.about))[None]

    def change(self, amounts: np.ndarray, size: float) -> np.ndarray:
        return np.sqrt(2) * np.linalg.norm(self.turn) * np.abs(amounts[:, 0]) * size


class RigidMotion(Kind):
    takes = Motion
    meaning = "prescribed rigid motion: {translate, rotate: {axis, degrees, about}}"
    axes = (("rotate", "axis"),)

    @classmethod
    def made(cls, value: Motion, where: OnFaces) -> Prescribed:
        turn, about = np.zeros(3), np.zeros(3)
        if value.rotate is not None:
            turn, about = np.radians(value.rotate.degrees) * np.array(unit(value.rotate.axis)), np.array(value.rotate.about)
        return Prescribed(np.ones(3, dtype=bool), where.factors[:, None], Rigid(np.array(value.translate), turn, about))
