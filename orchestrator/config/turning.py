"""Axes and turns, wherever the YAML has them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import Field

from orchestrator.config.base import Part, Vector, either
from orchestrator.errors import KeyPath, Problem

Axis = either(Literal["x", "y", "z"], Vector, lambda value: isinstance(value, str), "x, y or z, or a vector of three numbers")


def unit(axis: str | list[float]) -> list[float]:
    """The direction of an axis, of length one."""
    if isinstance(axis, str):
        return [float(axis == name) for name in "xyz"]
    size = sum(x * x for x in axis) ** 0.5
    return [x / size for x in axis]


class Rotate(Part):
    """A turn about an axis, right-handed."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    degrees: float = Field(description="angle, right-handed about the axis")
    about: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")


def no_direction(path: KeyPath, axis: Any) -> Iterator[Problem]:
    """The problem of a raw axis of no length."""
    if isinstance(axis, list) and not any(axis):
        yield Problem(path, str(axis), "a direction: a vector other than zero", "write axis: z, or [0, 0, 1]")
