"""What a picture of a surface is made of: points, colours, lines, a camera; the same whoever draws it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.results.figures.plotting import DPI

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

WIDTH = 9.0  # of a figure, inches
_FLATTEST, _TALLEST = 0.22, 0.75  # height of a drawing over its width


@dataclass(frozen=True)
class Camera:
    """Parallel projection with z upward.

    Parameters
    ----------
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
    def framing(cls, points: np.ndarray, margin: float = 0.04, direction: np.ndarray | None = None) -> Camera:
        """A view that just holds ``points`` (n, 3), from a direction (3,); none: from the front, right and above.

        Slender bodies are seen more from the side, so that their length runs across the picture.
        """
        size = np.sort(np.ptp(points, axis=0))
        toward = toward_eye(points) if direction is None else np.asarray(direction, float) / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], toward)
        if np.linalg.norm(right) < 1e-6:  # from above or below: y is up
            right = np.array([1.0, 0.0, 0.0]) * (1 if toward[2] > 0 else -1)
        right /= np.linalg.norm(right)
        up = np.cross(toward, right)
        seen = points @ np.stack([right, up, toward], axis=1)
        low, high = seen.min(axis=0), seen.max(axis=0)
        span = np.maximum(high - low, 1e-9 * max(size[2], 1e-300))
        pad = 2 * margin * span[:2].max()
        focus = np.stack([right, up, toward], axis=1) @ (0.5 * (low + high))
        return cls(focus, toward, right, up, float(span[0] + pad), float(span[1] + pad))

    def shaped(self) -> Camera:
        """The same with more room around, where the picture would be very flat or very tall."""
        ratio = min(max(self.height / self.width, _FLATTEST), _TALLEST)
        return replace(self, width=max(self.width, self.height / ratio), height=max(self.height, self.width * ratio))


def toward_eye(points: np.ndarray) -> np.ndarray:
    """(3,) unit vector from points (n, 3) to where they are seen from unless something else is asked for."""
    extent = np.ptp(points, axis=0)
    slender = np.sort(extent)[2] > 3 * np.sort(extent)[1]
    direction = {0: (0.45, -1.0, 0.45), 1: (1.0, -0.45, 0.45), 2: (0.7, -1.0, 0.3)}[int(np.argmax(extent))] \
        if slender else (0.75, -1.0, 0.6)
    return np.array(direction) / np.linalg.norm(direction)


def viridis() -> Colormap:
    """The colours of quantities: readable in grey and by the colour-blind."""
    from matplotlib import colormaps

    return colormaps["viridis"]


@dataclass(frozen=True)
class View:
    """What is drawn: a coloured surface, lines, a camera and a caption.

    Parameters
    ----------
    points : (p, 3) deformed; triangles : (k, 3) int
    values : (p,) what gives the colour
    lines, outline : (e, 2, 3) edges on the surface, undeformed edges
    limits : of the colour scale; beyond : whether values lie below and above it
    caption : one line
    palette : colours from the lower limit to the upper
    inches : width of the picture
    shaded : whether light falls on it; without, colours are exactly those of the scale
    closed : whether the triangles are those of whole bodies, turned outward: the far side of a body is then never seen
    magnified : factor on the displacements drawn
    mark : place (3,) of the largest value, the value, and whether it is on a face turned to the eye; None: not marked
    """

    points: np.ndarray
    triangles: np.ndarray
    values: np.ndarray
    lines: np.ndarray
    outline: np.ndarray
    camera: Camera
    limits: tuple[float, float]
    beyond: tuple[bool, bool] = (False, False)
    caption: str = ""
    palette: Colormap = field(default_factory=viridis)
    inches: float = WIDTH
    shaded: bool = True
    closed: bool = False
    magnified: float = 1.0
    mark: tuple[np.ndarray, float, bool] | None = None

    @property
    def pixels(self) -> tuple[int, int]:
        """Columns and rows of the picture."""
        columns = int(self.inches * DPI)
        return columns, round(columns * self.camera.height / self.camera.width)


# Of the surface, percentiles that may be the ends of the scale: the widest whose upper quartile is visibly above the lowest
# colour, so that a peak in a corner leaves no picture of one dark colour.
ENDS, VISIBLE = (99.5, 98.0, 95.0, 90.0), 0.15


def colour_limits(values: np.ndarray, weights: np.ndarray | None = None) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Colour limits that a singular corner does not stretch, and whether values lie beyond them.

    Parameters
    ----------
    values : (n,), nan where nothing is known
    weights : (n,) area that each stands for; None: the same
    """
    known = np.isfinite(values)
    if not known.any():
        return (0.0, 1.0), (False, False)
    order = np.argsort(values[known], kind="stable")
    sorted_ = values[known][order]
    share = np.arange(1.0, len(order) + 1) - 0.5 if weights is None else np.cumsum(weights[known][order]) - 0.5 * weights[known][order]
    total = float(len(order)) if weights is None else float(weights[known].sum())
    if total <= 0:
        return colour_limits(values)

    def at(percent: float) -> float:
        return float(np.interp(percent / 100 * total, share, sorted_))

    lowest, highest = float(sorted_[0]), float(sorted_[-1])
    for end in ENDS:
        low, high = at(100 - end), at(end)
        if at(75.0) - low >= VISIBLE * (high - low):
            break
    if high - low > 0.6 * (highest - lowest):
        low, high = lowest, highest
    if high - low <= 1e-6 * abs(high):  # uniform: rounding is no pattern
        low, high = (0.0, 2.0 * high) if high > 0 else (0.0, 1.0)
    return (low, high), (lowest < low, highest > high)
