"""A picture of a surface as data: what is chosen of it, points, colours, lines and a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.plotting import DPI, viridis
from orchestrator.scene.names import matching

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

WIDTH = 9.0  # of a figure, inches
NO_LINES = np.empty((0, 2, 3))
_FLATTEST, _TALLEST = 0.22, 0.75  # height of a drawing over its width


@dataclass(frozen=True)
class Camera:
    """Parallel projection with z upward.

    focus : (3,) the point at the picture's centre
    toward : (3,) unit vector from the scene to the eye; right, up : (3,) the picture's axes
    width, height : of the picture, in the model's unit
    """

    focus: np.ndarray
    toward: np.ndarray
    right: np.ndarray
    up: np.ndarray
    width: float
    height: float

    def project(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points to (..., 3): right, up (from the picture's centre) and depth toward the eye."""
        return (points - self.focus) @ np.stack([self.right, self.up, self.toward], axis=1)

    @classmethod
    def framing(cls, points: np.ndarray, direction: np.ndarray | None = None, margin: float = 0.04) -> Camera:
        """A view that just holds ``points`` (n, 3), from a direction (3,); default: ``toward_eye``."""
        toward = toward_eye(points) if direction is None else np.asarray(direction, float) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], toward)
        if np.linalg.norm(right) < 1e-6:  # from above or below: y is up
            right = np.array([1.0, 0.0, 0.0]) * (1 if toward[2] > 0 else -1)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(toward, right), toward], axis=1)
        low, high = (points @ axes).min(axis=0), (points @ axes).max(axis=0)
        span = np.maximum(high - low, 1e-9 * max(np.ptp(points, axis=0).max(), 1e-300))
        pad = 2 * margin * span[:2].max()
        width, height = span[:2] + pad
        ratio = min(max(height / width, _FLATTEST), _TALLEST)  # neither very flat nor very tall
        width, height = max(width, height / ratio), max(height, width * ratio)
        return cls(axes @ (0.5 * (low + high)), toward, right, axes[:, 1], float(width), float(height))


def toward_eye(points: np.ndarray) -> np.ndarray:
    """(3,) unit vector from points (n, 3) to the eye: from the front, right and above; slender bodies lie across the picture."""
    extent = np.ptp(points, axis=0)
    slender = np.sort(extent)[2] > 3 * np.sort(extent)[1]
    direction = {0: (0.45, -1.0, 0.45), 1: (1.0, -0.45, 0.45), 2: (0.7, -1.0, 0.3)}[int(np.argmax(extent))]
    direction = np.array(direction if slender else (0.75, -1.0, 0.6))
    return direction / np.linalg.norm(direction)


@dataclass(frozen=True)
class View:
    """A coloured surface with lines on it, as one camera sees it.

    points : (p, 3) as drawn; triangles : (k, 3) int
    values : (p,) what gives the colour; nan is grey
    camera : where it is seen from
    limits : of the colour scale; extremes : the lowest and the highest value, beyond it or not
    lines, outline : (e, 2, 3) edges on the surface, undeformed edges
    palette : colours from the lower limit to the upper
    shaded : whether light falls on it; without, colours are exactly those of the scale
    closed : whether the triangles are those of whole bodies, turned outward: the far side of a body is then never seen
    mark : place (3,) of the largest value, the value, and whether it is on a face turned to the eye; None: not marked
    names : places (3,) and the text below each
    """

    points: np.ndarray
    triangles: np.ndarray
    values: np.ndarray
    camera: Camera
    limits: tuple[float, float]
    extremes: tuple[float, float] | None = None
    lines: np.ndarray = field(default_factory=lambda: NO_LINES)
    outline: np.ndarray = field(default_factory=lambda: NO_LINES)
    palette: Colormap = field(default_factory=viridis)
    shaded: bool = True
    closed: bool = False
    mark: tuple[np.ndarray, float, bool] | None = None
    names: Sequence[tuple[np.ndarray, str]] = ()

    def pixels(self, inches: float = WIDTH) -> tuple[int, int]:
        """Columns and rows of the picture in a width."""
        columns = int(inches * DPI)
        return columns, round(columns * self.camera.height / self.camera.width)


# Of the surface, percentiles that may be the ends of the scale: the widest whose upper quartile is visibly above the lowest
# colour, so that a peak in a corner leaves no picture of one dark colour.
ENDS, VISIBLE = (99.5, 98.0, 95.0, 90.0), 0.15
NEAR = 0.05  # of the scale, by which the lowest value may be below its end to be its end


def colour_limits(values: np.ndarray, weights: np.ndarray | None = None) -> tuple[tuple[float, float], tuple[float, float]]:
    """Colour limits that a singular corner does not stretch, and the lowest and highest value.

    values : (n,), nan where nothing is known
    weights : (n,) area that each stands for; None: the same
    """
    known = np.isfinite(values)
    if not known.any():
        return (0.0, 1.0), (0.0, 1.0)
    order = np.argsort(values[known], kind="stable")
    ranked, weight = values[known][order], np.ones(len(order)) if weights is None else weights[known][order]
    if weight.sum() <= 0:
        return colour_limits(values)
    percent = 100 * (np.cumsum(weight) - 0.5 * weight) / weight.sum()
    for end in ENDS:
        low, quartile, high = np.interp([100 - end, 75.0, end], percent, ranked).tolist()
        if quartile - low >= VISIBLE * (high - low):
            break
    lowest, highest = float(ranked[0]), float(ranked[-1])
    if high - low > 0.6 * (highest - lowest):
        low, high = lowest, highest
    if low - lowest < NEAR * (high - low):
        low = lowest
    if high - low <= 1e-6 * abs(high):  # uniform: rounding is no pattern
        low, high = (0.0, 2.0 * high) if high > 0 else (0.0, 1.0)
    return (low, high), (lowest, highest)


NO_UNITS = {"length": "", "force": "", "stress": ""}


@dataclass(frozen=True)
class Look:
    """Choice of what is drawn of a structure.

    parts : patterns of their names; none: all
    cut : axis (0, 1, 2) and place of a plane; what is in front of it is left out; None: nothing is cut
    angles : degrees of the eye, from x towards y, and above; None: as suits the structure
    steps : load steps that are drawn, from 0; none: as suits the result
    scale : ends of the stresses' colours; "step": each load step has its own; None: one for all, as suits the result
    units : of length, force and stress, each with a space before; empty where none are named
    """

    parts: tuple[str, ...] = ()
    cut: tuple[int, float] | None = None
    angles: tuple[float, float] | None = None
    steps: tuple[int, ...] = ()
    scale: tuple[float, float] | str | None = None
    units: Mapping[str, str] = field(default_factory=lambda: NO_UNITS)

    @classmethod
    def of(cls, figures: object, units: Mapping[str, str] = NO_UNITS) -> Look:
        """The look from ``output.figures`` of a complete configuration."""
        if not isinstance(figures, Mapping):
            return cls(units=units)
        cut, view, scale = figures.get("cut"), figures.get("view"), figures.get("scale")
        return cls(tuple(figures.get("parts") or ()), cut and ("xyz".index(cut["plane"]), cut["at"]),
                   view and (view["azimuth"], view["elevation"]), tuple(step - 1 for step in figures.get("steps") or ()),
                   tuple(scale) if isinstance(scale, list) else scale, units)

    @property
    def direction(self) -> np.ndarray | None:
        """(3,) unit vector to the eye; None: as suits the structure."""
        if self.angles is None:
            return None
        azimuth, elevation = np.radians(self.angles)
        return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])

    def of_steps(self, count: int) -> list[int]:
        """The load steps of ``steps`` that there are, in order: a run may have stopped before others."""
        return sorted({step for step in self.steps if step < count})

    def chosen(self, names: tuple[str, ...], part: np.ndarray | None, count: int) -> np.ndarray:
        """(k,) int, the tets that are drawn of ``count``; all of them where no part has such a name."""
        if not self.parts or part is None:
            return np.arange(count)
        wanted = np.isin(names, [name for pattern in self.parts for name in matching(pattern, names)])
        return np.flatnonzero(wanted[part]) if wanted.any() else np.arange(count)
