"""``output.probes``: values that are asked of the solution, at points, along paths, over faces and
across sections.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from orchestrator.config.base import Name, Part, Vector, one_of
from orchestrator.config.boundary import Cut, Where

ProbeName = Annotated[str, Field(pattern=r"^\w[\w. -]*$")]
Quantity = Literal["displacement", "stress"]


class PointProbe(Part):
    """A value at a point of the undeformed body."""

    name: ProbeName | None = Field(None,
                                   description="in the results; none: probe_1, probe_2, … by its "
                                   "place in the list")
    at: Vector = Field(description="the point, in the undeformed body")
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever has "
        "the point, where it is one"))
    quantity: Quantity = Field("displacement",
                               description="displacement, or the stress at the nodes, linear "
                               "between them")


class PathProbe(Part):
    """Values along a straight line through the undeformed body, into paths.csv."""

    name: ProbeName | None = PointProbe.model_fields["name"]
    along: Annotated[list[Vector],
                     Field(min_length=2, max_length=2)] = Field(
                         description="the line's ends: [[x, y, z], [x, y, z]]")
    points: Annotated[int, Field(ge=2, le=1000)] = Field(21, description=(
        "how many points, evenly spaced, ends included; twenty intervals show what a few elements "
        "resolve"))
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever the "
        "line is in"))
    quantity: Quantity = PointProbe.model_fields["quantity"]


class SurfaceProbe(Part):
    """A value over faces: the mean, an extreme with its place, or the resultant of all that acts on
    them.
    """

    name: ProbeName | None = PointProbe.model_fields["name"]
    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    part: Name | None = Field(None, description=(
        "name of the volume or body whose faces are meant, shell wildcards allowed; none: "
        "whichever has them"))
    quantity: Literal["mean", "max", "min", "resultant"] = Field("mean", description=(
        "mean: by area; max, min: of every component, with its place; resultant: force and moment "
        "that act on the faces"))
    of: Quantity | None = Field(None,
                                description="what the mean or extreme is of: displacement, as "
                                "where nothing is said, or stress")
    about: Vector | None = Field(None,
                                 description="the moment of a resultant is about this point; none: "
                                 "the surface's centre")


class SectionProbe(Part):
    """Force and moment that matter carries across a plane: what is in front of it, where the normal
    points, exerts on what is behind.
    """

    name: ProbeName | None = PointProbe.model_fields["name"]
    section: Cut = Field(
        description="the plane: {plane: z, at: 12}, or {plane: [0, 1, 1], at: [0, 5, 5]}")
    part: Name | None = Field(None, description=(
        "name of the volume or body that is cut, shell wildcards allowed; none: all that the "
        "plane cuts"))
    about: Vector | None = Field(None,
                                 description="the moment is about this point; none: the plane's "
                                 "point, as at says")


Probe = one_of({"at": PointProbe, "along": PathProbe, "section": SectionProbe, "on": SurfaceProbe},
               "{at: [x, y, z], quantity: displacement}, {along: [[x, y, z], [x, y, z]]}, "
               "{section: {plane: z, at: 12}} or {on: top, quantity: max, of: stress}")
