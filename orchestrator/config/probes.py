"""``output.probes``: values that are asked of the solution, at points, along paths, over faces and across sections."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from orchestrator.config.base import Name, Part, Vector, one_of
from orchestrator.config.boundary import Cut, Where

ProbeName = Annotated[str, Field(pattern=r"^\w[\w. -]*$")]
Quantity = Literal["displacement", "stress"]
Certified = Annotated[bool, Field(description=(
    "add the interval that the energy error leaves for each component of displacement, of force and moment, or of stress: the mean over "
    "the tet at the point, or over those behind the faces, as no energy bounds the stress at a point; off, as it costs a few answers of "
    "the code"))]
Accuracy = Annotated[float | None, Field(gt=0, lt=1, description=(
    "what mesh and iterations together may leave of error, relative to the displacement's or the force's largest length: the run is "
    "repeated on meshes that are finer where that pays, within method.accuracy's limits; none: no matter"))]
Force = Literal["reactions", "bolts", "sections", "resultants"]


class PointProbe(Part):
    """A value at a point of the undeformed body."""

    name: ProbeName | None = Field(None, description="in the results; none: probe_1, probe_2, … by its place in the list")
    at: Vector = Field(description="the point, in the undeformed body")
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever has the point, where it is one"))
    quantity: Quantity = Field("displacement", description="displacement, or the stress at the nodes, linear between them")
    certified: Certified = False
    accuracy: Accuracy = None


class PathProbe(Part):
    """Values along a straight line through the undeformed body, into paths.csv."""

    certified: ClassVar[bool] = False
    accuracy: ClassVar[None] = None
    name: ProbeName | None = PointProbe.model_fields["name"]
    along: Annotated[list[Vector], Field(min_length=2, max_length=2)] = Field(description="the line's ends: [[x, y, z], [x, y, z]]")
    points: Annotated[int, Field(ge=2, le=1000)] = Field(21, description=(
        "how many points, evenly spaced, ends included; twenty intervals show what a few elements resolve"))
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever the line is in"))
    quantity: Quantity = PointProbe.model_fields["quantity"]


class SurfaceProbe(Part):
    """A value over faces: the mean, an extreme with its place, or the resultant of all that acts on them."""

    name: ProbeName | None = PointProbe.model_fields["name"]
    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    part: Name | None = Field(None, description=(
        "name of the volume or body whose faces are meant, shell wildcards allowed; none: whichever has them"))
    quantity: Literal["mean", "max", "min", "resultant"] = Field("mean", description=(
        "mean: by area; max, min: of every component, with its place; resultant: force and moment that act on the faces"))
    of: Quantity | None = Field(None, description="what the mean or extreme is of: displacement, as where nothing is said, or stress")
    about: Vector | None = Field(None, description="the moment of a resultant is about this point; none: the surface's centre")
    certified: Certified = False
    accuracy: Accuracy = None


class SectionProbe(Part):
    """Force and moment that matter carries across a plane: what is in front of it, where the normal points, exerts on what is behind."""

    name: ProbeName | None = PointProbe.model_fields["name"]
    section: Cut = Field(description="the plane: {plane: z, at: 12}, or {plane: [0, 1, 1], at: [0, 5, 5]}")
    part: Name | None = Field(None, description=(
        "name of the volume or body that is cut, shell wildcards allowed; none: all that the plane cuts"))
    about: Vector | None = Field(None, description="the moment is about this point; none: the plane's point, as at says")
    certified: Certified = False
    accuracy: Accuracy = None


Probe = one_of({"at": PointProbe, "along": PathProbe, "section": SectionProbe, "on": SurfaceProbe},
               "{at: [x, y, z], quantity: displacement}, {along: [[x, y, z], [x, y, z]]}, {section: {plane: z, at: 12}} or "
               "{on: top, quantity: max, of: stress}")
