"""``boundary``, ``loads`` and ``interfaces``: what acts on the body and between its parts."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from orchestrator.config.base import Name, Part, PartlyFree, Positive, Vector, as_list, either, one_or_per_step


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
Gap = either(Literal["geometry"], float, lambda value: isinstance(value, str), "a number, or geometry")


class BoundaryCondition(Part):
    """Exactly one of displacement, traction and pressure, on a place."""

    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    displacement: Displacement | None = Field(None, description="prescribed components; null leaves one free")
    traction: Traction | None = Field(None, description="force per area")
    pressure: float | None = Field(None, description="force per area along the inward normal")
    history: Name | None = Field(None, description="name of the factors per load step; none: the same at every step")


class BodyForce(Part):
    """A force per volume on the volumes it names; several add up."""

    on: Annotated[list[Name], BeforeValidator(as_list), Field(min_length=1)] = Field(
        ["*"], description="names of volumes, shell wildcards allowed; * because weight acts everywhere")
    body_force: Traction = Field(description="force per volume")
    history: Name | None = Field(None, description="name of the factors per load step; none: the same at every step")


class InterfaceLaw(Part):
    """The law between two parts; the last match wins."""

    between: Annotated[list[Name], Field(min_length=2, max_length=2)] = Field(
        ["*", "*"], description="names of the two parts, shell wildcards allowed, in either order")
    law: Literal["perfect", "contact", "jump"] = Field("perfect", description="perfect: bonded, the undamaged body")
    friction: float | None = Field(None, ge=0, description="Coulomb's coefficient, 0 or above, for contact; none: 0")
    gap: Gap | None = Field(None, description=(
        "initial gap for contact, negative for a press fit, or geometry: as far as the sides are apart; none: 0"))
    within: Positive | None = Field(None, description=(
        "search distance of gap: geometry, a length; none: twice the local element size"))
    jump: Vector | None = Field(None, description="imposed jump from the first part to the second, for jump")


def everything_perfect() -> list[Any]:
    """Default of ``interfaces``."""
    return [InterfaceLaw()]
