"""Rigid tools: bodies without a mesh that interfaces are with, as ``between: [part, {sphere:
{centre: …, radius: …}, …}]``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import Field

from orchestrator.config.base import (
    Axis, Frame, Name, Part, PartlyFree, Positive, Vector, no_direction, one_or_per_step, unit)
from orchestrator.config.paths import find, free_at_times, get, rows_of
from orchestrator.errors import KeyPath, Problem
from orchestrator.registry import DEFAULT_LAW, TOOL_LAW

# Keys of contact that mean nothing beside a tool, and what does in their place.
NOT_BESIDE = {"gap": "the gap is what the tool's surface leaves: move the tool",
              "slave": "the part's nodes carry the contact",
              "exclude": "name the part that is meant",
              "tolerance": "within says how far from the tool faces are sought",
              "history": "put it beside the tool's displacement or force, inside its mapping"}
AXES = "xyz"
Moved = one_or_per_step(PartlyFree,
                        "three numbers (null: free), or a list of such, one per load step")
Loaded = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")


class Plane(Part):
    """A plane; the tool is all that is behind it."""

    at: Vector = Field(description="a point of it")
    normal: Axis = Field(
        description="out of the tool, towards the part: x, y, z, or a direction [x, y, z]")

    @property
    def direction(self) -> list[float]:
        """The normal, of length one."""
        return unit(self.normal)


class Sphere(Part):
    """A ball, or the ball's hollow."""

    centre: Vector = Field(description="its centre")
    radius: Positive = Field(description="its radius")
    hollow: bool = Field(False, description="true: the part is inside, and the tool all around")


class Cylinder(Frame):
    """A cylinder without ends, or a bore."""

    radius: Positive = Field(description="its radius")
    hollow: bool = Field(False, description="true: the part is inside, and the tool all around")


class Tool(Part):
    """A rigid body without a mesh: one of plane, sphere and cylinder, and how it moves or what
    pushes it.
    """

    plane: Plane | None = Field(None, description="{at: [x, y, z], normal: z}")
    sphere: Sphere | None = Field(None, description="{centre: [x, y, z], radius: 5}")
    cylinder: Cylinder | None = Field(None, description="{axis: y, at: [x, y, z], radius: 5}")
    name: Name | None = Field(None,
                              description="what it is called in messages and results; none: by its "
                              "shape")
    displacement: Moved | None = Field(None, description=(
        "of the tool; null where it is free; none: 0, and free in components that force pushes it "
        "in"))
    rotation: Moved | None = Field(None, description=(
        "degrees about x, y and z through `about`; null where it may turn; none: 0, and free in "
        "components of moment"))
    force: Loaded = Field([0.0, 0.0, 0.0], description="on the tool, in components that are free")
    moment: Loaded = Field([0.0, 0.0, 0.0],
                           description="on the tool about `about`, in components that are free")
    about: Vector | None = Field(None, description=(
        "the point that moves and turns; none: of a sphere the centre, of the others `at`"))
    history: Name | None = Field(None,
                                 description="name of the factors per load step, of all these; "
                                 "none: the same at every step")

    @property
    def shape(self) -> str:
        """The shape that is given."""
        return next(key for key in SHAPES if getattr(self, key) is not None)

    @property
    def vectors(self) -> list | None:
        """The vectors that it lists, one per load step; None where it lists none."""
        return next(
            (given for key in LISTED
             if isinstance((given := getattr(self, key) or [0.0])[0], list)), None)

    @property
    def amounts(self) -> list[list[list[float | None]]]:
        """At each load step that is listed, else at one, the six prescribed amounts, None where it
        is free, and the six loads.
        """
        moves, loads = ([self._rows(key) for key in pair] for pair in (MOVES, LOADS))
        for k, (move, load) in enumerate(zip((self.displacement, self.rotation), loads)):
            if move is None:  # what pushes it frees it
                moves[k] = [[None if any(row[c] for row in load) else 0.0 for c in range(3)]]
        count = max(map(len, (*moves, *loads)))
        return [[[x for rows in pair for x in rows[min(step, len(rows) - 1)]]
                 for pair in (moves, loads)] for step in range(count)]

    def _rows(self, key: str) -> list[list[float | None]]:
        given = getattr(self, key) or [0.0, 0.0, 0.0]
        return given if isinstance(given[0], list) else [given]


SHAPES = ("plane", "sphere", "cylinder")
MOVES, LOADS = ("displacement", "rotation"), ("force", "moment")
LISTED = (*MOVES, *LOADS)
PLACE = ("interfaces", "*", "between", 1)


def tools_fit(data: Any) -> Iterator[Problem]:
    """Tools are in contact, by keys that mean something there, and what is prescribed of them is
    not loaded.
    """
    for path, entry in find(data, PLACE[:2]):
        for at, tool in find(entry, PLACE[2:], path):
            if not isinstance(tool, dict):
                continue
            if entry.get("law") != TOOL_LAW:
                yield Problem((*path, "law"),
                              f"law: {entry.get('law', DEFAULT_LAW)} with a rigid tool",
                              f"law: {TOOL_LAW}",
                              f"write law: {TOOL_LAW}; what is glued to something rigid is held "
                              "under boundary")
            for key, cure in NOT_BESIDE.items():
                if entry.get(key) not in (None, "geometry" if key == "gap" else "auto"
                                          if key == "tolerance" else None):
                    yield Problem((*path, key), f"{key} beside a rigid tool", f"no {key} there",
                                  f"remove it: {cure}")
            if entry.get("pairing") == "follow":
                yield Problem((*path, "pairing"), "follow beside a rigid tool", "pairing: fixed",
                              "remove it: the gap is that of the tool where it has moved to, at "
                              "every load step")
            for shape, key in (("plane", "normal"), ("cylinder", "axis")):
                yield from (found for place, axis in find(tool, (shape, key), at)
                            for found in no_direction(place, axis))
            yield from _driven(at, tool)
            if get(data, "method", "accuracy") is not None:
                yield Problem(("method", "accuracy"), "accuracy beside a rigid tool",
                              "a mesh of one's own there",
                              "remove accuracy, and refine the mesh by hand where the tool touches")


def _driven(path: KeyPath, tool: dict[str, Any]) -> Iterator[Problem]:
    """Require that what is prescribed is not loaded, and a component is free at all load steps or
    at none.
    """
    for move, load in zip(MOVES, LOADS):
        moves, loads = (rows_of(tool.get(key)) for key in (move, load))
        yield from free_at_times((*path, move), moves)
        for c in range(3) if moves else ():
            if all(row[c] is not None for row in moves) and any(row[c] for row in loads):
                yield Problem((*path, load),
                              f"component {AXES[c]} of {load}, in which {move} holds the tool",
                              "one of the two: what is prescribed is not loaded",
                              f"write null for it in {move}, or 0 in {load}")
