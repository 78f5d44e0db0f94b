"""``output``: what is written, where, and what is asked of the solution."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from orchestrator.config.base import Name, Names, Part, Vector, either
from orchestrator.config.boundary import Where

ProbeName = Annotated[str, Field(pattern=r"^\w[\w. -]*$")]
Quantity = Literal["displacement", "stress"]


class PointProbe(Part):
    """A value at a point of the undeformed body."""

    name: ProbeName | None = Field(None, description="in the results; none: probe_1, probe_2, … by its place in the list")
    at: Vector = Field(description="the point, in the undeformed body")
    part: Name | None = Field(None, description=(
        "name of the volume or body that is meant, shell wildcards allowed; none: whichever has the point, where it is one"))
    quantity: Quantity = Field("displacement", description="displacement, or the stress at the nodes, linear between them")


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


Probe = either(PointProbe, SurfaceProbe, lambda value: isinstance(value, PointProbe) or (isinstance(value, dict) and "at" in value),
               "{at: [x, y, z], quantity: displacement} or {on: top, quantity: max, of: stress}")
UnitName = Annotated[str, Field(pattern=r"^[^\s/*]{1,12}$")]


class Units(Part):
    """What the model's numbers are measured in: named beside them, nothing is converted."""

    length: UnitName = Field(description="unit of the mesh's coordinates, such as mm")
    force: UnitName = Field(description="unit of forces, such as N; moduli and stresses are then force/length²")

    @property
    def stress(self) -> str:
        """Unit of stresses, with the name that the usual pairs have."""
        known = {("N", "mm"): "MPa", ("N", "m"): "Pa", ("kN", "m"): "kPa", ("kN", "mm"): "GPa", ("MN", "m"): "MPa"}
        return known.get((self.force, self.length), f"{self.force}/{self.length}²")


class Cut(Part):
    """A plane that is cut along: what is in front of it, seen from the eye, is left out."""

    plane: Literal["x", "y", "z"] = Field(description="axis normal to the plane")
    at: float = Field(description="coordinate of the plane along that axis")


class Eye(Part):
    """Where the structure is seen from."""

    azimuth: float = Field(description="degrees around z, from x towards y")
    elevation: Annotated[float, Field(ge=-90, le=90)] = Field(description="degrees above the plane of x and y")


class Figures(Part):
    """How the structure is drawn."""

    cut: Cut | None = Field(None, description="{plane, at}: shows the inside; none: the surface")
    parts: Names | None = Field(None, description="names of the volumes that are drawn, shell wildcards allowed; none: all")
    view: Eye | None = Field(None, description="{azimuth, elevation}; none: from the front, right and above")


Drawn = either(Figures, bool, lambda value: isinstance(value, (dict, Figures)), "true or false, or a mapping with cut, parts, view")


class Output(Part):
    directory: Name | None = Field(None, description="results folder; none: results/<name>")
    fields: bool = Field(True, description="write displacement and stress fields; cheap beside the solve")
    figures: Drawn = Field(True, description=("draw the figures, as they are what most people look at first; or how: {cut, parts, view}"))
    probes: list[Probe] = Field([], description=(
        "values that are asked for, at points and on surfaces; into summary.json, probes.csv and a figure"))
    moments_about: Vector = Field([0.0, 0.0, 0.0], description=(
        "reactions' moments are about this point; the origin by default, which no one has to look up"))
    units: Units | None = Field(None, description="names of the units of length and force, shown beside numbers; none: no units")
