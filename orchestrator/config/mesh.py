"""``mesh``, ``subdomains`` and ``materials``: the body and how it is cut."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue

from orchestrator.config.base import Count, Counts, Name, Names, Part, Positive, Sizes, auto_or, either

CubeOrBox = either(Positive, Sizes, lambda value: not isinstance(value, list), "a number > 0 (a cube's side), or three of them")
# One element size, or one for each pattern of names.
Size = either(Annotated[dict[Name, Positive], Field(min_length=1)], Positive, lambda value: isinstance(value, dict),
              "a number > 0, or {name: number}")
# a tetrahedron has twelve
Dofs = auto_or(Annotated[int, Field(ge=12)], "a number of dofs >= 12")


class Beam(Part):
    """A structured beam of tetrahedra, from the origin along the axes."""

    size: Sizes = Field(description="lengths along x, y and z")
    h: Positive = Field(description="element size; each length is cut into round(length / h) cells")


class Box(Part):
    """A structured box of tetrahedra, from the origin along the axes."""

    size: Sizes = Field(description="lengths along x, y and z")
    cells: Counts = Field(description="hexahedral cells along x, y and z, each cut into tetrahedra")


class Polycrystal(Part):
    """A cube or box filled with the grains of a Voronoi tessellation."""

    grains: Annotated[int, Field(ge=1, le=10_000)] = Field(
        description="number of grains, up to 10,000: at h of .3 of a grain, meshing takes half a minute per thousand")
    size: CubeOrBox = Field(description="the cube's side, or lengths along x, y and z")
    h: Positive = Field(description="element size")
    seed: int = Field(7, ge=0, description="of the random grain centres; fixed, so that runs repeat")
    lloyd: int = Field(0, ge=0, le=100, description="relaxation steps towards rounder grains; 0: the paper's kind of grains")


class Mesh(Part):
    """Exactly one source, and how to scale it."""

    beam: Beam | None = Field(None, description="a structured beam: {size, h}")
    box: Box | None = Field(None, description="a structured box: {size, cells}")
    polycrystal: Polycrystal | None = Field(None, description="Voronoi grains: {grains, size, h, seed, lloyd}")
    file: Name | None = Field(None, description="a mesh file of solid elements, relative to the YAML file")
    step: Name | None = Field(None, description="a STEP or BREP file, relative to the YAML file")
    h: Size | None = Field(None, description=(
        "element size for `step`; none: the mesher derives one from the shape; with `conforming: false` also by solid, "
        "{'*': 5, 'bolt*': 2}, the last match wins"))
    conforming: bool | None = Field(None, description=(
        "of `step`: false: each solid is meshed by itself, at its own h, and touching ones share nothing; none: true, "
        "touching solids share their faces"))
    exclude: Names | None = Field(None, description=("of `step`: names of solids that are left out, shell wildcards allowed"))
    scale: Positive = Field(1.0, description="factor on all coordinates; 1 because files are taken as they are")


class Slices(Part):
    axis: Literal["x", "y", "z"] = Field(description="direction in which the slices follow one another")
    count: Count = Field(description="number of slices of equal thickness")


class Subdomains(Part):
    """Exactly one way to cut. The word ``groups`` stands for ``{groups: true}``."""

    slices: Slices | None = Field(None, description="slices of equal thickness: {axis, count}")
    grid: Counts | None = Field(None, description="boxes of equal size along x, y and z")
    metis: Count | None = Field(None, description="number of connected parts of about equal size")
    groups: Literal[True] | None = Field(None, description="one subdomain per physical volume, solid or grain")
    split_above: Dofs | None = Field(None, description=(
        "with `groups`: dofs (three per node) above which a volume is cut further, in pieces joined by perfect "
        "interfaces; auto: as many as cost twice the mean of the volumes; none: volumes stay whole"))

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"groups": True} if value == "groups" else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [handler(core), {"const": "groups"}]}


class Material(Part):
    """Isotropic linear elasticity on the volumes it names; the last match wins."""

    young: Positive = Field(description="Young's modulus, above 0, in force per area of your units")
    poisson: float = Field(gt=-1, lt=0.5, description=(
        "Poisson's ratio, between -1 and 0.5, both excluded: displacement elements lock at 0.5; take 0.49 at most for rubber-like matter"))
    density: Positive | None = Field(None, description="mass per volume, for gravity and spin; none: no weight is asked for")
    expansion: float | None = Field(None, description=(
        "thermal strain per temperature, for temperatures under loads; none: nothing is heated"))
    on: Names = Field(["*"], description="names of volumes, shell wildcards allowed; * because most bodies are of one matter")
