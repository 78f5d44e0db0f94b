"""``boundary``, ``loads`` and ``interfaces``: what acts on the body and between its parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from orchestrator.config.base import ByName, Name, Names, Part, PartlyFree, Vector, either, one_or_per_step
from orchestrator.config.entry import Entry
from orchestrator.registry import LAWS


class Place(Part):
    """Boundary faces on a plane, or inside a box."""

    plane: Literal["x", "y", "z"] | None = Field(None, description="axis normal to the plane; comes with `at`")
    at: float | None = Field(None, description="coordinate of the plane along that axis")
    box: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = Field(
        None, description="lower and upper corner: [[x, y, z], [x, y, z]]")


Where = either(Place, Name, lambda value: isinstance(value, (dict, Place)),
               "the name of a surface group, {plane: x, at: 0}, or {box: [[0, 0, 0], [1, 1, 1]]}")
Displacement = one_or_per_step(PartlyFree, "three numbers (null: free), or a list of such, one per load step")
Traction = one_or_per_step(Vector, "three numbers, or a list of such, one per load step")


class BoundaryCondition(Part):
    """Exactly one of displacement, traction and pressure, on a place."""

    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    displacement: Displacement | None = Field(None, description="prescribed components; null leaves one free")
    traction: Traction | None = Field(None, description="force per area")
    pressure: float | None = Field(None, description="force per area along the inward normal")
    history: Name | None = Field(None, description="name of the factors per load step; none: the same at every step")


class BodyForce(Part):
    """A force per volume on the volumes it names; several add up."""

    on: Names = Field(
        ["*"], description="names of volumes, shell wildcards allowed; * because weight acts everywhere")
    body_force: Traction = Field(description="force per volume")
    history: Name | None = Field(None, description="name of the factors per load step; none: the same at every step")


Interfaces = list[ByName(Entry, "law", LAWS, lambda law: law.Parameters).mapping]


def everything_perfect() -> list[Entry]:
    """Default of ``interfaces``."""
    return [Entry()]
