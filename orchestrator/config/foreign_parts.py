"""Parts whose mesh is not this program's: a stiffness matrix with its nodes, a deck of another code."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from orchestrator.config.base import Name, Names, Part, Vector, either

# One file for all load steps, or one for each.
PerStep = Annotated[list[Name], BeforeValidator(lambda value: [value] if isinstance(value, str) else value,
                                                json_schema_input_type=list[Name] | Name), Field(min_length=1)]
Held = either(Literal["auto"], bool, lambda value: isinstance(value, str), "auto, true or false")


class ForeignPart(Part):
    """What all such parts have in common.

    Attributes
    ----------
    kind : the key in ``parts``, and the name in ``registry.FOREIGN``
    files : keys that name files beside the YAML
    """

    kind: ClassVar[str]
    files: ClassVar[tuple[str, ...]]

    held: Held = Field("auto", description=(
        "whether supports inside the part hold it; auto: as the deck says, else not. It is compared with what rigid motions cost"))
    history: Name | None = Field(None, description="factors of its own loads, one per load step, from histories; none: 1")


class MatrixPart(ForeignPart):
    """A stiffness matrix and the table of its nodes; forces and displacements on its joints are all that is asked of it."""

    kind: ClassVar[str] = "matrix"
    files: ClassVar[tuple[str, ...]] = ("stiffness", "nodes", "loads", "facets")

    stiffness: Name = Field(description=(
        "symmetric matrix of three dofs per node, ux uy uz, in MatrixMarket's format, condensed to the joint or not"))
    nodes: Name = Field(description="a line id, x, y, z for each node, in the matrix's order")
    loads: PerStep | None = Field(None, description=(
        "nodal forces: a line id, fx, fy, fz for each node that has any, and three more per further load step; or MatrixMarket's format, "
        "in the matrix's order, which nothing checks, a column per load step, or one for all; none: no loads"))
    facets: Name | None = Field(None, description=(
        "the joints' faces, a line each: ids of 3, 4, 6 or 8 nodes, corners first, anticlockwise seen from outside"))
    outward: Vector | None = Field(None, description="of a flat joint without facets: the normal that points out of the part")


class DeckPart(ForeignPart):
    """A CalculiX deck, included as it is; forces and displacements on its joints are all that is asked of it."""

    kind: ClassVar[str] = "deck"
    files: ClassVar[tuple[str, ...]] = ("calculix", "loads")

    calculix: Name = Field(description="the deck up to its first *STEP: nodes, elements, sets, matter, supports")
    loads: PerStep | None = Field(None, description=(
        "cards between *STATIC and *END STEP, one file for all load steps or one for each; none: no loads"))
    nonlinear: bool = Field(False, description=(
        "whether its matter flows (*PLASTIC): load steps are then replayed from the first one, an increment each"))
    joints: Names = Field(description="names of node sets, *NSET; the part meets others on the elements' faces between their nodes")


class ProgramPart(ForeignPart):
    """A program in any language: started in an empty folder with springs.txt and forces.txt, it leaves displacements.txt and
    joint.txt."""

    kind: ClassVar[str] = "program"
    files: ClassVar[tuple[str, ...]] = ("run", "facets")

    run: Name = Field(description="the program or script, which may be executed")
    arguments: list[str] = Field([], description="words that it is started with; what it reads from elsewhere it finds by absolute paths")
    facets: Name | None = MatrixPart.model_fields["facets"]
    outward: Vector | None = MatrixPart.model_fields["outward"]
    loads: bool = Field(False, description="whether it has loads of its own, asked for by the number of the load step; history multiplies them")
    nonlinear: bool = Field(False, description=(
        "whether it remembers load steps: the cases of a call are then load steps, each from the end of the one before"))
    timeout: Annotated[float, Field(gt=0, le=1e6)] = Field(3600.0, description="seconds allowed for one call")


KINDS: dict[str, type[ForeignPart]] = {kind.kind: kind for kind in (MatrixPart, DeckPart, ProgramPart)}


def file_keys(entry: dict[str, Any]) -> list[tuple[str, str]]:
    """Of a raw entry of ``parts``, the places (kind, key) that name files."""
    return [(name, key) for name, kind in KINDS.items() if isinstance(entry.get(name), dict) for key in kind.files]
