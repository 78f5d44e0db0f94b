"""``blackbox``: which code solves which subdomains. A code brings the model of its own entries;
none is known here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from orchestrator.config.base import AutoCount, ByName, Name, Names, Part, either
from orchestrator.errors import KeyPath
from orchestrator.registry import CODES, DEFAULT_CODE


class CodeSettings(Part):
    """Keys that the entries of all codes understand.

    A code derives its own from it: fewer words where it cannot do all, more keys where it has
    options. The last entry that matches a subdomain wins.

    Examples
    --------
    >>> class Mine(CodeSettings):
    ...     transport: Literal["file"] = "file"
    ...     digits: int = 12
    >>> Mine(digits=14).model_dump(exclude={"timeout"})
    {'code': 'freefem', 'on': ['*'], 'element': 'P1', 'transport': 'file', 'workers': 'auto',
    'digits': 14}
    """

    # what a code's own entries may say otherwise, as properties
    # whether its models have loads of their own, beside those of the YAML
    brings_loads: ClassVar[bool] = False
    # whether they are nonlinear and remember load steps, which are then solved one after the other
    remembers: ClassVar[bool] = False
    # whether it is told the solution once more, and writes results of its own
    writes_results: ClassVar[bool] = False
    # sentences on what is not known before a program is run, which the user has to ask for
    unasked: ClassVar[tuple[str, ...]] = ()

    code: Name = Field(DEFAULT_CODE, description=(
        "the finite element code, or a solver of your own; none: the one that is the fastest here"))
    on: Names = Field(["*"],
                      description="names of subdomains, shell wildcards allowed; * because the "
                      "first entry is for all others")
    element: Literal["P1", "P2", "auto"] = Field("P1", description=(
        "P1: linear tetrahedra, the paper's element; P2: a node on every edge too, far better in "
        "bending; auto: P2 unless the mesh is too large for it, and says why"))
    transport: Literal["pipe", "file"] = Field("pipe", description=(
        "pipe: persistent processes that keep their factors; file: one run per request, for closed "
        "codes, or one for the interface compliance where that is cheaper"))
    workers: AutoCount = Field("auto", description="processes; auto: one per core")
    timeout: Annotated[float, Field(gt=0, le=1e6)] = Field(600.0, description=(
        "seconds allowed for one answer; 600 is far above a factorisation of 200,000 dofs"))

    @classmethod
    def beside(cls, entry: dict[str, Any], folder: Path) -> dict[str, Any]:
        """The raw entry with the files it names found beside the YAML file, where they are there;
        none by default.
        """
        return entry


def _own() -> str:
    own = ", ".join(kind.forms for kind in CODES.own())
    return (
        f"or your own solver: {own}; matrices, decks and programs are parts, parts: [{{matrix: "
        f"…}}]")


_BY_CODE = ByName(CodeSettings, "code", CODES, lambda code: code.Settings, _own)

BlackBoxes = either(Annotated[list[_BY_CODE.mapping], Field(min_length=1)], _BY_CODE.mapping,
                    lambda value: isinstance(value, list),
                    f"a mapping such as {{code: {DEFAULT_CODE}}}, or a list of such, each with "
                    "on: [names of subdomains]")


def settings_class(entry: Any) -> type[CodeSettings]:
    """The model of a raw entry: that of the code it names; where it names none, one that says which
    there are.
    """
    return _BY_CODE.model(entry)


def entry_path(index: int, entries: Sequence[CodeSettings]) -> KeyPath:
    """Place of an entry in the YAML: a single one is the section itself."""
    return ("blackbox", index) if len(entries) > 1 else ("blackbox",)
