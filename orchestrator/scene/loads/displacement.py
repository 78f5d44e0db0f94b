"""``displacement``: components that are prescribed, along x, y and z or along cylindrical directions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import PartlyFree, one_or_per_step
from orchestrator.config.paths import free_at_times, rows_of, shown
from orchestrator.errors import KeyPath, Problem, dotted
from orchestrator.scene.loads.base import Field, Ground, Kind, OnFaces, Prescribed, ROUNDING, Uniform
from orchestrator.scene.loads.frame import Cylindrical
from orchestrator.scene.loads.foundation import Springs


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
    takes = one_or_per_step(PartlyFree, "three numbers (null: free), or a list of such, one per load step")
    meaning = "prescribed components; null leaves one free"
    listed = True

    @classmethod
    def broken(cls, path: KeyPath, value: Any, entry: dict[str, Any]) -> Iterator[Problem]:
        rows = rows_of(value)
        if rows and all(x is None for row in rows for x in row):
            yield Problem(path, "no prescribed component", "at least one number", "remove the entry, or prescribe a component")
        yield from free_at_times(path, rows)

    @classmethod
    def broken_among(cls, entries: Sequence[tuple[KeyPath, Any, dict[str, Any]]]) -> Iterator[Problem]:
        """Require that one place is not told two different things."""
        seen: dict[tuple[str, int], tuple[KeyPath, Any]] = {}
        for path, value, entry in entries:
            for component, values in enumerate(zip(*rows_of(value))):
                if None in values:
                    continue
                told = values, entry.get("history") if any(values) else None  # zero stays zero whatever the history
                first, other = seen.setdefault((shown(entry.get("on")), component), (path, told))
                if other != told:
                    yield Problem((*path, "displacement"), f"component {'xyz'[component]} of this place prescribed again, differently",
                                  f"one value, as in {dotted(first)}", "remove one of the two, or free it with null")
                    break

    @classmethod
    def turned(cls, value: Any) -> bool:
        return True

    @classmethod
    def made(cls, value: Any, where: OnFaces) -> Prescribed | Ground:
        fixed, values = where.rows(value)
        if where.frame is None:
            return Prescribed(fixed, values, Uniform())
        if fixed.all():
            where.check_frame(values)
            return Prescribed(fixed, values, Turned(where.frame))
        where.check_frame(fixed)
        return Springs(np.where(fixed, np.inf, 0.0), values, where.frame)
