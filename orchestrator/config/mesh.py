"""``mesh``, ``subdomains`` and ``materials``: the body and how it is cut.

And ``parts``: several put together in one scene, in place of ``mesh``; each with a mesh of its own,
or a model of another program's: a stiffness matrix with its nodes, a deck, a program.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue

from orchestrator.config.base import (
    Count, Counts, Name, Names, Part, Positive, Rotate, Sizes, Vector, auto_or, either)

CubeOrBox = either(Positive, Sizes, lambda value: not isinstance(value, list),
                   "a number > 0 (a cube's side), or three of them")
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
        description="number of grains, up to 10,000: at h of .3 of a grain, meshing takes half a "
                    "minute per thousand")
    size: CubeOrBox = Field(description="the cube's side, or lengths along x, y and z")
    h: Positive = Field(description="element size")
    seed: int = Field(7, ge=0,
                      description="of the random grain centres; fixed, so that runs repeat")
    lloyd: int = Field(0, ge=0, le=100,
                       description="relaxation steps towards rounder grains; 0: the paper's kind "
                       "of grains")


class Curved(Part):
    """Elements as small as curved faces ask for."""

    curvature: Annotated[float,
                         Field(ge=3, le=1000)] = Field(
                             description="elements on a full circle, 12 say; plane faces do not "
                                         "count")
    min: Positive | None = Field(None,
                                 description="elements are no smaller, however small a fillet is; "
                                 "none: no such limit")
    max: Positive | None = Field(None,
                                 description="elements are no larger; none: a tenth of the model's "
                                 "size")


OneSize = either(Curved, Positive, lambda value: isinstance(value, (dict, Curved)),
                 "a number > 0, or {curvature: 12, max: 5}")
# One element size, or one for each pattern of names.
Size = either(Annotated[dict[Name, OneSize], Field(min_length=1)], OneSize,
              lambda value: isinstance(value, dict) and "curvature" not in value,
              "a number > 0, {curvature: 12, max: 5}, or one of these for each solid: {name: "
              "number}")


class Refined(Part):
    """Smaller elements on some faces, and around them."""

    on: Names = Field(
        description="names of solids or of their faces, shell wildcards allowed: plate:3, 'bolt*'")
    h: Positive = Field(description="element size there; sizes grow into the solid from there on")


class MeshEntry(Part):
    """Exactly one source, and how to scale it."""

    beam: Beam | None = Field(None, description="a structured beam: {size, h}")
    box: Box | None = Field(None, description="a structured box: {size, cells}")
    polycrystal: Polycrystal | None = Field(None,
                                            description="Voronoi grains: {grains, size, h, seed, "
                                            "lloyd}")
    file: Name | None = Field(None, description=(
        "a mesh file of solid elements, relative to the YAML file; or a pattern, bracket_*.msh, of "
        "gmsh's files of one mesh, each with a partition"))
    step: Name | None = Field(None, description="a STEP or BREP file, relative to the YAML file")
    h: Size | None = Field(None, description=(
        "element size for `step`, or {curvature: 12, min: 0.5, max: 5} by curved faces; none: the "
        "mesher derives one from the shape; with `conforming: false` also by solid, {'*': 5, "
        "'bolt*': 2}, the last match wins"))
    refine: list[Refined] | None = Field(None, description=(
        "of `step`: smaller elements on solids or faces, [{on: 'plate:3', h: 1}], the smallest "
        "wins"))
    conforming: bool | None = Field(None, description=(
        "of `step`: false: each solid is meshed by itself, at its own h, and touching ones share "
        "nothing; none: true, touching solids share their faces"))
    exclude: Names | None = Field(None,
                                  description=(
                                      "of `step`: names of solids that are left out, shell "
                                      "wildcards allowed"))
    rename: Annotated[dict[Name, Name], Field(min_length=1)] | None = Field(None, description=(
        "of `step` and `file`: names of your own for volumes, {solid_1: bolt}; all other keys "
        "then go by these"))
    scale: Positive = Field(1.0,
                            description="factor on all coordinates; 1 because files are taken as "
                            "they are")


class Slices(Part):
    axis: Literal["x", "y",
                  "z"] = Field(description="direction in which the slices follow one another")
    count: Count = Field(description="number of slices of equal thickness")


class Subdomains(Part):
    """Exactly one way to cut. The word ``groups`` stands for ``{groups: true}``."""

    slices: Slices | None = Field(None, description="slices of equal thickness: {axis, count}")
    grid: Counts | None = Field(None, description="boxes of equal size along x, y and z")
    metis: Count | None = Field(None, description="number of connected parts of about equal size")
    groups: Literal[True] | None = Field(None,
                                         description="one subdomain per physical volume, solid or "
                                         "grain")
    split_above: Dofs | None = Field(None, description=(
        "with `groups`: dofs (three per node) above which a volume is cut further, in pieces "
        "joined by perfect interfaces; auto: as many as cost twice the mean of the volumes; none: "
        "volumes stay whole"))

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"groups": True} if value == "groups" else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any,
                                     handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [handler(core), {"const": "groups"}]}


class MaterialEntry(Part):
    """Isotropic linear elasticity on the volumes it names; the last match wins."""

    young: Positive = Field(description="Young's modulus, above 0, in force per area of your units")
    poisson: float = Field(gt=-1, lt=0.5, description=(
        "Poisson's ratio, between -1 and 0.5, both excluded: displacement elements lock at 0.5; "
        "take 0.49 at most for rubber-like matter"))
    density: Positive | None = Field(None,
                                     description="mass per volume, for gravity and spin; none: no "
                                     "weight is asked for")
    expansion: float | None = Field(None, description=(
        "thermal strain per temperature, for temperatures under loads; none: nothing is heated"))
    on: Names = Field(["*"],
                      description="names of volumes, shell wildcards allowed; * because most "
                      "bodies are of one matter")


class ForeignPart(Part):
    """A part whose mesh is not this program's. What it has of ``loads``, each kind says."""

    kind: ClassVar[str]  # the key in ``parts``, and the name in ``registry.FOREIGN``
    files: ClassVar[tuple[str, ...]]  # keys that name files beside the YAML

    held: either(Literal["auto"], bool, lambda value: isinstance(value, str),
                 "auto, true or false") = Field("auto", description=(
        "whether supports inside the part hold it; auto: as the deck says, else not. It is "
        "compared with what rigid motions cost"))
    history: Name | None = Field(None,
                                 description="factors of its own loads, one per load step, from "
                                 "histories; none: 1")


class MatrixPart(ForeignPart):
    """A stiffness matrix and the table of its nodes; forces and displacements on its joints are all
    that is asked of it.
    """

    kind = "matrix"
    files = ("stiffness", "nodes", "loads", "facets")

    stiffness: Name = Field(description=(
        "symmetric matrix of three dofs per node, ux uy uz, in MatrixMarket's format, condensed "
        "to the joint or not"))
    nodes: Name = Field(description="a line id, x, y, z for each node, in the matrix's order")
    loads: Names | None = Field(None, description=(
        "nodal forces: a line id, fx, fy, fz for each node that has any, and three more per "
        "further load step; or MatrixMarket's format, in the matrix's order, which nothing checks, "
        "a column per load step, or one for all; none: no loads"))
    facets: Name | None = Field(None, description=(
        "the joints' faces, a line each: ids of 3, 4, 6 or 8 nodes, corners first, anticlockwise "
        "seen from outside"))
    outward: Vector | None = Field(None,
                                   description="of a flat joint without facets: the normal that "
                                   "points out of the part")


class DeckPart(ForeignPart):
    """A CalculiX deck, included as it is; forces and displacements on its joints are all that is
    asked of it.
    """

    kind = "deck"
    files = ("calculix", "loads")

    calculix: Name = Field(
        description="the deck up to its first *STEP: nodes, elements, sets, matter, supports")
    loads: Names | None = Field(None, description=(
        "cards between *STATIC and *END STEP, one file for all load steps or one for each; none: "
        "no loads"))
    joints: Names = Field(
        description="names of node sets, *NSET; the part meets others on the elements' faces "
                    "between their nodes")


class ProgramPart(ForeignPart):
    """A program in any language: started in an empty folder with springs.txt and forces.txt, it
    leaves displacements.txt and joint.txt.
    """

    kind = "program"
    files = ("run", "facets")

    run: Name = Field(description="the program or script, which may be executed")
    arguments: list[str] = Field([],
                                 description="words that it is started with; what it reads from "
                                 "elsewhere it finds by absolute paths")
    facets: Name | None = MatrixPart.model_fields["facets"]
    outward: Vector | None = MatrixPart.model_fields["outward"]
    loads: bool = Field(False, description=(
        "whether it has loads of its own, asked for by the number of the load step; history "
        "multiplies them"))
    timeout: Annotated[float, Field(gt=0, le=1e6)] = Field(3600.0,
                                                           description="seconds allowed for one "
                                                           "call")


KINDS: dict[str, type[ForeignPart]] = {kind.kind: kind
                                       for kind in (MatrixPart, DeckPart, ProgramPart)}


class Move(Part):
    """The move of a part's mesh: turned first, then shifted."""

    rotate: Annotated[list[Rotate], Field(min_length=1), BeforeValidator(
        lambda value: [value] if isinstance(value, (dict, Rotate)) else value,
        json_schema_input_type=list[Rotate] | Rotate)] | None = Field(
        None, description="a turn {axis, degrees, about}, or several, one after another")
    translate: Vector | None = Field(None, description="a shift [x, y, z], after the turns")


class PartMatter(Part):
    """Isotropic linear elasticity of a whole part."""

    young: Positive = MaterialEntry.model_fields["young"]
    poisson: float = MaterialEntry.model_fields["poisson"]
    density: Positive | None = MaterialEntry.model_fields["density"]


class OnePart(Part):
    """One part with its own mesh: its volumes are called after it, its surfaces
    ``part/surface``.
    """

    name: Annotated[str, Field(pattern=r"^\w[\w. -]*$")] = Field(
        description="letters, digits, '-', '_', '.' and spaces: its volumes go by it, its "
                    "surfaces by name/surface")
    mesh: MeshEntry | None = Field(None,
                                   description="exactly one of beam, box, polycrystal, file and "
                                   "step, as without parts")
    matrix: MatrixPart | None = Field(None,
                                      description="in place of mesh: a stiffness matrix, "
                                      "{stiffness: K.mtx, nodes: nodes.csv, …}")
    deck: DeckPart | None = Field(None,
                                  description="in place of mesh: a CalculiX deck, {calculix: "
                                  "part.inp, joints: [flange], …}")
    program: ProgramPart | None = Field(None, description=(
        "in place of mesh: a program of your own, {run: ./my_solver.sh, outward: [0, 0, 1], …}"))
    h: Positive | None = Field(None,
                               description="element size for a mesh from `step`, in place of the "
                               "mesh's own h")
    move: Move | None = Field(None,
                              description="{translate: [x, y, z], rotate: {axis: z, degrees: 30}}; "
                              "none: it stays where it is")
    material: PartMatter | None = Field(None, description=(
        "{young, poisson}; none: what `materials` says; it comes after those entries, so that it "
        "wins"))
    element: Literal["P1", "P2"] | None = Field(None, description=(
        "as under blackbox; none: what is said there; one element for all parts"))

    @property
    def foreign(self) -> ForeignPart | None:
        """The part that takes the place of a mesh of this program's; None where it has one."""
        return next((given for kind in KINDS if (given := getattr(self, kind)) is not None), None)

    @property
    def source(self) -> MeshEntry:
        """The mesh with the part's own element size."""
        return self.mesh if self.h is None else self.mesh.model_copy(update={"h": self.h})


def elements_of(parts: Any) -> list[tuple[int, str]]:
    """The raw parts that name an element, and which."""
    return [(i, part["element"]) for i, part in enumerate(parts if isinstance(parts, list) else [])
            if isinstance(part, dict) and isinstance(part.get("element"), str)]
