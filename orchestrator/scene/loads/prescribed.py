"""Displacements that are prescribed: ``displacement``, along x, y and z or along cylindrical
directions, ``symmetry``, a plane held along its normal, and ``motion``, a rigid one, u = s + ω ×
(x − p).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field as Key

from orchestrator.config.base import one_or_per_step, Part, PartlyFree, Rotate, unit, Vector
from orchestrator.config.paths import free_at_times, rows_of, shown
from orchestrator.errors import dotted, KeyPath, Problem
from orchestrator.linalg import WRITTEN
from orchestrator.scene.loads.base import (
    Cylindrical, FacePlace, Field, Ground, Kind, Prescribed, ROUNDING, Uniform)
from orchestrator.scene.loads.grounds import Springs
from orchestrator.scene.mesh.geometry import area_vectors


@dataclass(frozen=True)
class Turned(Field):
    """One along the radial, tangential and axial direction each."""

    frame: Cylindrical

    turns = True

    def at(self, points: np.ndarray) -> np.ndarray:
        along = self.frame.directions(points).transpose(1, 0, 2)
        return np.where(np.abs(along) > ROUNDING, along, 0.0)

    def change(self, amounts: np.ndarray, size: float) -> np.ndarray:
        return np.abs(amounts).max(axis=1)


class Displacement(Kind):
    takes = one_or_per_step(PartlyFree,
                            "three numbers (null: free), or a list of such, one per load step")
    meaning = "prescribed components; null leaves one free"
    listed = True

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        rows = rows_of(value)
        if rows and all(x is None for row in rows for x in row):
            yield Problem(path, "no prescribed component", "at least one number",
                          "remove the entry, or prescribe a component")
        yield from free_at_times(path, rows)

    @classmethod
    def broken_among(cls,
                     entries: Sequence[tuple[KeyPath, Any, dict[str, Any]]]) -> Iterator[Problem]:
        """Require that one place is not told two different things."""
        seen: dict[tuple[str, int], tuple[KeyPath, Any]] = {}
        for path, value, entry in entries:
            for component, values in enumerate(zip(*rows_of(value))):
                if None in values:
                    continue
                # zero stays zero whatever the history
                told = values, entry.get("history") if any(values) else None
                first, other = seen.setdefault((shown(entry.get("on")), component), (path, told))
                if other != told:
                    yield Problem((*path, "displacement"),
                                  f"component {'xyz'[component]} of this place prescribed again, "
                                  "differently",
                                  f"one value, as in {dotted(first)}",
                                  "remove one of the two, or free it with null")
                    break

    @classmethod
    def turned(cls, value: Any) -> bool:
        return True

    @classmethod
    def made(cls, value: Any, where: FacePlace) -> Prescribed | Ground:
        fixed, values = where.rows(value)
        if where.frame is None:
            return Prescribed(fixed, values, Uniform())
        if fixed.all():
            where.check_frame(values)
            return Prescribed(fixed, values, Turned(where.frame))
        where.check_frame(fixed)
        return Springs(np.where(fixed, np.inf, 0.0), values, where.frame)


class Symmetry(Kind):
    takes = Literal[True]
    meaning = "true: held along the normal of a plane across an axis"

    @classmethod
    def made(cls, value: Any, where: FacePlace) -> Prescribed:
        vectors = np.abs(area_vectors(where.nodes, where.triangles[:, :3]))
        axis = int(vectors.sum(axis=0).argmax())
        if not (np.delete(vectors, axis, axis=1) <= WRITTEN * vectors[:, axis, None]).all():
            where.problems.add((*where.path[:-1], "on"),
                               "a plane of symmetry that is curved, or across no axis",
                               "faces on a plane across x, y or z",
                               "turn the model so that the plane is across an axis (parts have "
                               "move: {rotate: …}), or select the plane's faces alone")
        return Prescribed(np.arange(3) == axis, np.zeros((len(where.factors), 3)), Uniform())


class MotionEntry(Part):
    """A rigid motion: a shift, and a turn that is small."""

    translate: Vector = Key([0.0, 0.0, 0.0], description="the shift of points on the turn's axis")
    rotate: Rotate | None = Key(None, description="{axis, degrees, about}; none: no turn")


@dataclass(frozen=True)
class RigidField(Field):
    """A shift (3,), and a small turn (3,), in radians, about a point (3,)."""

    shift: np.ndarray
    turn: np.ndarray
    about: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        return (self.shift + np.cross(self.turn, points - self.about))[None]

    def change(self, amounts: np.ndarray, size: float) -> np.ndarray:
        return np.sqrt(2) * np.linalg.norm(self.turn) * np.abs(amounts[:, 0]) * size


class RigidMotion(Kind):
    takes = MotionEntry
    meaning = "prescribed rigid motion: {translate, rotate: {axis, degrees, about}}"
    axes = (("rotate", "axis"),)

    @classmethod
    def made(cls, value: MotionEntry, where: FacePlace) -> Prescribed:
        turn, about = np.zeros(3), np.zeros(3)
        if value.rotate is not None:
            turn, about = np.radians(value.rotate.degrees) * np.array(
                unit(value.rotate.axis)), np.array(value.rotate.about)
        return Prescribed(np.ones(3, dtype=bool), where.factors[:, None],
                          RigidField(np.array(value.translate), turn, about))
