"""The lists as text, in columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from orchestrator.scene.inspection.content import SurfaceRow, VolumeRow
from orchestrator.scene.inspection.pairs import PairRow
from orchestrator.scene.inspection.shapes import Shape


def volume_table(rows: Iterable[VolumeRow], matter: Mapping[str, str] | None = None) -> list[str]:
    """Lines on volumes.

    matter : what each is made of, where that is known
    """
    heads = ("volume", "tets", "volume", "element", "centre", "from", "to")
    return _columns(heads + (("material",) if matter else ()), [
        (r.name, str(r.tets), _number(r.volume), _number(r.size), _point(r.centre), _point(r.low), _point(r.high),
         *((matter.get(r.name, "-"),) if matter else ())) for r in rows])


def surface_table(rows: Iterable[SurfaceRow]) -> list[str]:
    """Lines on surfaces; of a plane the normal, of a cylinder the axis; neighbours of the same volume by what follows the colon."""
    return _columns(("surface", "triangles", "area", "centre", "kind", "normal, axis", "beside"),
                    [(r.name, str(r.triangles), _number(r.area), _point(r.centre), _kind(r.shape),
                      "-" if r.shape.direction is None else _point(r.shape.direction), _short(r.name, r.neighbours) or "-") for r in rows])


def _kind(shape: Shape) -> str:
    return shape.kind if shape.radius is None else f"{shape.kind}, radius {_number(shape.radius)}"


def _short(name: str, others: Sequence[str]) -> str:
    start = name.rpartition(":")[0] + ":"
    return " ".join(other.removeprefix(start[:-1]) if len(start) > 1 and other.startswith(start) else other for other in others)


def pair_table(rows: Iterable[PairRow], most: int | None = None) -> list[str]:
    """Lines on pairs.

    most : how many are shown; None: all
    """
    rows = list(rows)
    shown = rows[:most]
    lines = _columns(("pair", "area", "distance", "meshes", "slave", "elements", "law"),
                     [(f"{r.one} | {r.two}", _number(r.area), _range(r.nearest, r.farthest), r.meshes, r.slave or "-",
                       _range(*r.size), r.law or "-") for r in shown])
    return lines + ([f"… and {len(rows) - len(shown)} more"] if len(shown) < len(rows) else [])


def _columns(heads: Sequence[str], rows: list[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(heads, *rows)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in (heads, *rows)]


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}"


def _range(low: float, high: float) -> str:
    low, high = (f"{value + 0.0:.2g}" for value in (low, high))
    return low if low == high else f"{low} … {high}"


def _point(point: np.ndarray) -> str:
    return "(" + ", ".join(_number(float(np.round(x, 9))) for x in point) + ")"
