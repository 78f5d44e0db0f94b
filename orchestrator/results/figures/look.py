"""How a figure of the structure is to look: which parts, cut where, seen from where, in which units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from orchestrator.scene.names import matching

NO_UNITS = {"length": "", "force": "", "stress": ""}


@dataclass(frozen=True)
class Look:
    """What is drawn of a structure.

    parts : patterns of their names; none: all
    cut : axis (0, 1, 2) and place of a plane; what is in front of it is left out; None: nothing is cut
    angles : degrees of the eye, from x towards y, and above; None: as suits the structure
    units : of length, force and stress, each with a space before; empty where none are named
    """

    parts: tuple[str, ...] = ()
    cut: tuple[int, float] | None = None
    angles: tuple[float, float] | None = None
    units: Mapping[str, str] = field(default_factory=lambda: NO_UNITS)

    @classmethod
    def of(cls, figures: object, units: Mapping[str, str] = NO_UNITS) -> Look:
        """From ``output.figures`` of a complete configuration."""
        if not isinstance(figures, Mapping):
            return cls(units=units)
        cut, view = figures.get("cut"), figures.get("view")
        return cls(tuple(figures.get("parts") or ()), cut and ("xyz".index(cut["plane"]), cut["at"]),
                   view and (view["azimuth"], view["elevation"]), units)

    @property
    def direction(self) -> np.ndarray | None:
        """(3,) unit vector to the eye; None: as suits the structure."""
        if self.angles is None:
            return None
        azimuth, elevation = np.radians(self.angles)
        return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])

    def chosen(self, names: tuple[str, ...], part: np.ndarray | None, count: int) -> np.ndarray:
        """(k,) int, the tets that are drawn of ``count``; all of them where no part has such a name."""
        if not self.parts or part is None:
            return np.arange(count)
        wanted = np.isin(names, [name for pattern in self.parts for name in matching(pattern, names)])
        return np.flatnonzero(wanted[part]) if wanted.any() else np.arange(count)
