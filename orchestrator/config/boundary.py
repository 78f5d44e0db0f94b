"""``boundary``, ``loads`` and ``interfaces``: what acts on the body and between its parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from orchestrator.config.base import ByName, Name, Names, Part, PartlyFree, Positive, Vector, either, one_or_per_step
from orchestrator.config.entry import Entry
from orchestrator.config.turning import Axis, Rotate
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


class Resultant(Part):
    """A force and a moment on a surface as a whole, spread over it as a traction that varies linearly."""

    force: Vector = Field([0.0, 0.0, 0.0], description="the force; zero by default, for a moment alone")
    moment: Vector = Field([0.0, 0.0, 0.0], description="the moment about `about`; zero by default")
    about: Vector | None = Field(None, description="where the force acts, on the surface or not; none: the surface's centre")


class LinearPressure(Part):
    """A pressure that varies linearly, as a liquid's."""

    value: float = Field(0.0, description="at the point `at`, force per area along the inward normal")
    at: Vector = Field(description="a point, as one of a liquid's surface")
    gradient: Vector = Field(description="change per length along x, y and z")


class Motion(Part):
    """A rigid motion: a shift, and a turn that is small."""

    translate: Vector = Field([0.0, 0.0, 0.0], description="the shift of points on the turn's axis")
    rotate: Rotate | None = Field(None, description="{axis, degrees, about}; none: no turn")


class Frame(Part):
    """Cylindrical directions about an axis: radial, tangential and axial, right-handed."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    at: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")


class Foundation(Part):
    """Springs to a rigid ground: along the normal and across it, or along three directions."""

    normal: Positive | None = Field(None, description="stiffness along the surface's normal, force per area and per length")
    tangential: float | None = Field(None, ge=0, description="stiffness across it, beside normal; none: 0")
    stiffness: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)] | None = Field(None, description=(
        "in place of the others: stiffness along x, y and z, or along the directions of a frame"))


class Coupling(Part):
    """A point that the surface follows: each of its six motions is prescribed, or null and loaded."""

    kind: Literal["rigid", "distributed"] = Field("rigid", description=(
        "rigid: the surface moves as a rigid body; distributed: so in the mean, weighted by area, and free to deform"))
    about: Vector | None = Field(None, description="the point, on the surface or not; none: the surface's centre")
    displacement: PartlyFree = Field([None, None, None], description="of the point; null where it is loaded, by `force`")
    rotation: PartlyFree = Field([None, None, None], description="degrees about x, y and z, small; null where loaded, by `moment`")
    force: Vector = Field([0.0, 0.0, 0.0], description="at the point, in components that are not prescribed")
    moment: Vector = Field([0.0, 0.0, 0.0], description="about the point, in components that are not prescribed")


Pressure = either(LinearPressure, float, lambda value: isinstance(value, (dict, LinearPressure)),
                  "a number, or {at: [0, 0, 10], gradient: [0, 0, -9.81e-6]}")


class BoundaryCondition(Part):
    """Exactly one of displacement, symmetry, motion, traction, pressure, resultant, foundation and coupling, on a place."""

    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    displacement: Displacement | None = Field(None, description="prescribed components; null leaves one free")
    symmetry: Literal[True] | None = Field(None, description="true: held along the normal of a plane across an axis")
    motion: Motion | None = Field(None, description="prescribed rigid motion: {translate, rotate: {axis, degrees, about}}")
    traction: Traction | None = Field(None, description="force per area")
    pressure: Pressure | None = Field(None, description=(
        "force per area along the inward normal: a number, or {value, at, gradient}"))
    resultant: Resultant | None = Field(None, description="force and moment as a whole: {force, moment, about}")
    foundation: Foundation | None = Field(None, description="springs to the ground: {normal, tangential}, or {stiffness: [x, y, z]}")
    coupling: Coupling | None = Field(None, description=(
        "remote displacement or load: {kind, about, displacement, rotation, force, moment}"))
    frame: Frame | None = Field(None, description=(
        "of a displacement, a traction or a foundation's stiffness: its components are radial, tangential and axial, {axis, at}"))
    history: Name | None = Field(None, description="name of the factors per load step; none: the same at every step")

    @property
    def stands(self) -> bool:
        """Whether a ground is behind it: others prescribe components x, y, z of nodes, or load faces."""
        if self.frame is not None and self.displacement is not None:
            rows = self.displacement if isinstance(self.displacement[0], list) else [self.displacement]
            return any(x is None for x in rows[0])
        return self.foundation is not None or self.coupling is not None


class Spin(Part):
    """A steady rotation, whose centrifugal force acts on matter that has a density."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    rate: float = Field(description="angle in radians per time")
    about: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")


class TemperatureField(Part):
    """A temperature that varies: linearly in space, or as a file says node by node."""

    value: float = Field(0.0, description="at the point `at`")
    at: Vector | None = Field(None, description="a point; comes with `gradient`")
    gradient: Vector | None = Field(None, description="change per length along x, y and z")
    file: Name | None = Field(None, description=(
        "text file relative to the YAML file, in place of the others: rows x y z T, a row for every node, or a column of "
        "temperatures for each load step"))


Temperature = either(TemperatureField, float, lambda value: isinstance(value, (dict, TemperatureField)),
                     "a number, or {at: [0, 0, 10], gradient: [0, 0, 2.5]}, or {file: warm.csv}")


class BodyForce(Part):
    """Exactly one of body_force, gravity, spin and temperature, on the volumes it names; several add up."""

    on: Names = Field(
        ["*"], description="names of volumes, shell wildcards allowed; * because weight acts everywhere")
    body_force: Traction | None = Field(None, description="force per volume")
    gravity: Vector | None = Field(None, description="acceleration, times the materials' density")
    spin: Spin | None = Field(None, description="{axis, rate, about}: centrifugal force by the materials' density")
    temperature: Temperature | None = Field(None, description=(
        "temperature above the one without stress, by the materials' expansion: a number, {value, at, gradient} or {file}"))
    history: Name | None = Field(None, description=(
        "name of the factors per load step, of the force or the temperature; none: the same at every step"))


Interfaces = list[ByName(Entry, "law", LAWS, lambda law: law.Parameters).mapping]


def everything_perfect() -> list[Entry]:
    """Default of ``interfaces``."""
    return [Entry()]
