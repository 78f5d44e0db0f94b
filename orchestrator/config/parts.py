"""``parts``: several put together in one scene, in place of ``mesh``; each with a mesh, or a model of another program's."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from orchestrator.config.base import Part, Positive, Vector
from orchestrator.config.foreign_parts import KINDS, DeckPart, ForeignPart, MatrixPart, ProgramPart
from orchestrator.config.mesh import Material, Mesh
from orchestrator.config.turning import Rotate


class Move(Part):
    """Where a part's mesh goes: turned first, then shifted."""

    rotate: Annotated[list[Rotate], Field(min_length=1), BeforeValidator(
        lambda value: [value] if isinstance(value, (dict, Rotate)) else value,
        json_schema_input_type=list[Rotate] | Rotate)] | None = Field(
        None, description="a turn {axis, degrees, about}, or several, one after another")
    translate: Vector | None = Field(None, description="a shift [x, y, z], after the turns")


class Matter(Part):
    """Isotropic linear elasticity of a whole part."""

    young: Positive = Material.model_fields["young"]
    poisson: float = Material.model_fields["poisson"]
    density: Positive | None = Material.model_fields["density"]


class OnePart(Part):
    """One part with its own mesh: its volumes are called after it, its surfaces ``part/surface``."""

    name: Annotated[str, Field(pattern=r"^\w[\w. -]*$")] = Field(
        description="letters, digits, '-', '_', '.' and spaces: its volumes go by it, its surfaces by name/surface")
    mesh: Mesh | None = Field(None, description="exactly one of beam, box, polycrystal, file and step, as without parts")
    matrix: MatrixPart | None = Field(None, description="in place of mesh: a stiffness matrix, {stiffness: K.mtx, nodes: nodes.csv, …}")
    deck: DeckPart | None = Field(None, description="in place of mesh: a CalculiX deck, {calculix: part.inp, joints: [flange], …}")
    program: ProgramPart | None = Field(None, description="in place of mesh: a program of your own, {run: ./my_solver.sh, outward: [0, 0, 1], …}")
    h: Positive | None = Field(None, description="element size for a mesh from `step`, in place of the mesh's own h")
    move: Move | None = Field(None, description="{translate: [x, y, z], rotate: {axis: z, degrees: 30}}; none: it stays where it is")
    material: Matter | None = Field(None, description=(
        "{young, poisson}; none: what `materials` says; it comes after those entries, so that it wins"))
    element: Literal["P1", "P2"] | None = Field(None, description=(
        "as under blackbox; none: what is said there; one element for all parts"))

    @property
    def foreign(self) -> ForeignPart | None:
        """What it is in place of a mesh of this program's; None where it has one."""
        return next((given for kind in KINDS if (given := getattr(self, kind)) is not None), None)

    @property
    def source(self) -> Mesh:
        """The mesh with the part's own element size."""
        return self.mesh if self.h is None else self.mesh.model_copy(update={"h": self.h})


def elements_of(parts: Any) -> list[tuple[int, str]]:
    """Of raw parts, those that name an element, and which."""
    return [(i, part["element"]) for i, part in enumerate(parts if isinstance(parts, list) else [])
            if isinstance(part, dict) and isinstance(part.get("element"), str)]
