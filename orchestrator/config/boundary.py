"""``boundary``, ``loads``, ``bolts`` and ``interfaces``: what acts on the body and between its
parts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, Strict, create_model

from orchestrator.config.base import (
    Axis, ByName, Frame, MadeModel, Name, Names, Part, Positive, Vector, auto_or, either)
from orchestrator.config.tools import Tool
from orchestrator.registry import BOLT_LAW, DEFAULT_LAW, IN_VOLUMES, LAWS, ON_FACES

Two = Annotated[list[Name], Field(min_length=2, max_length=2)]
Sides = either(Annotated[tuple[Name, Tool], Strict(False)], Two,
               lambda value: isinstance(value, (list, tuple)) and any(
    isinstance(one, (dict, Tool)) for one in value),
               "the names of two parts, or of one and then a rigid tool: [block, {sphere: {…}}]")
Between = either(Literal["auto"], Sides, lambda value: isinstance(value, str),
                 "auto, or a list of the names of two parts, or of one and a rigid tool")
# In units of the local element size.
Tolerance = auto_or(Annotated[float, Field(gt=0, le=10)],
                    "a number > 0, at most 10, in units of the element size")
RIGHT = 90.0  # degrees; faces that turn farther look away from each other
# Limits of distances and angles are round numbers, and so are drawings: what lies on a limit is
# within it, however coordinates round.
ROUND = 1 + 1e-9


def scaled(value: Any, factor: float) -> Any:
    """A number, or a list of such, times a factor."""
    return [scaled(x, factor) for x in value] if isinstance(value, list) else factor * value


class Entry(Part):
    """The law between two parts; the last match wins. Each law derives its own, with its
    parameters.
    """

    per_step: ClassVar[tuple[str, ...]] = ()  # keys that may be lists of vectors, one per load step
    # what a law's own entries may say otherwise, as properties
    # keys that a history multiplies; none where the law prescribes nothing
    scaled: ClassVar[tuple[str, ...]] = ()
    # key that has the sides' distance read from the geometry; empty where they must touch
    apart: ClassVar[str] = ""
    # distance up to which sides are sought, a length; None: as the scene thinks fit
    reach: ClassVar[float | None] = None
    follows: ClassVar[bool] = False  # whether the sides are paired anew as they slide
    # depth by which the sides may be inside each other before loading, a length
    fit: ClassVar[float] = 0.0

    between: Between = Field(["*", "*"], description=(
        "names of the two parts, shell wildcards allowed, in either order; auto: whatever parts' "
        "faces lie on each other, with gaps as they are; or the name of parts and a rigid tool, "
        "[block, {sphere: {centre: [0, 0, 9], radius: 9}}]"))
    exclude: Annotated[list[Two], Field(min_length=1)] | None = Field(None, description=(
        "pairs of names that the entry does not mean, shell wildcards allowed: [[bolt*, washer]]"))
    slave: Name | None = Field(None, description=(
        "where meshes do not match, the part whose nodes carry the interface; none: the softer "
        "under bonds, the covered one, the coarser one, in this order"))
    tolerance: Tolerance = Field("auto", description=(
        "how far apart faces may be that are paired across meshes that do not match, in units of "
        "the element size there; auto: 0.1, from surface to surface where faces are curved"))
    angle: Annotated[float, Field(gt=0, le=RIGHT)] | None = Field(None, description=(
        "degrees by which such faces may be off looking straight at each other; none: 45"))
    law: Name = Field(DEFAULT_LAW, description="perfect: bonded, the undamaged body")

    history: Name | None = Field(None, description=(
        "name of the factors per load step, of what the law prescribes: a jump, a gap, a force; "
        "none: the same at every step"))

    @classmethod
    def wrong_factors(cls, factors: Sequence[float]) -> tuple[str, str, str] | None:
        """The factors of a history that the law cannot have: what was found, what is expected, the
        cure.
        """
        return None

    def at_steps(self, factors: Sequence[float]) -> list[Entry]:
        """The entry at every load step, its ``history`` multiplied in; empty where it is the same
        at all of them.
        """
        if self.history is None:
            return []
        return [
            self.model_copy(update={key: scaled(getattr(self, key), factor) for key in self.scaled})
            for factor in factors]

    @property
    def kind(self) -> Any:
        """The class of its law."""
        return LAWS[self.law]

    @property
    def vectors(self) -> list | None:
        """The vectors that it lists, one per load step; None where it lists none."""
        return next((given for key in self.per_step
                     if isinstance((given := getattr(self, key))[0], list)), None)

    @property
    def tool(self) -> Tool | None:
        """The rigid tool that it is with; None where it is between parts."""
        return self.between[1] if isinstance(self.between[1], Tool) else None

    @property
    def found(self) -> bool:
        """Whether pairs are found rather than named."""
        return self.between == "auto"

    @property
    def pair(self) -> tuple[str, str]:
        """Patterns of the two parts' names; with a tool of the one."""
        return ("*", "*") if self.found else tuple(side for side in self.between
                                                   if side is not self.tool)

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        """Rules that concern several keys of the raw entry: key, what was found, what is expected,
        the cure.
        """
        return iter(())


class Place(Part):
    """Boundary faces on a plane, or inside a box."""

    plane: Literal["x", "y", "z"] | None = Field(None,
                                                 description="axis normal to the plane; comes with "
                                                 "`at`")
    at: float | None = Field(None, description="coordinate of the plane along that axis")
    box: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = Field(
        None, description="lower and upper corner: [[x, y, z], [x, y, z]]")


Where = either(Place, Name, lambda value: isinstance(value, (dict, Place)),
               "the name of a surface group, {plane: x, at: 0}, or {box: [[0, 0, 0], [1, 1, 1]]}")


class Acting(Part):
    """An entry of ``boundary`` or ``loads``: under the key of one kind it says what acts."""

    kinds: ClassVar[Mapping[str, Any]]

    @property
    def acts(self) -> str:
        """Name of its kind."""
        return next(name for name in self.kinds if getattr(self, name) is not None)

    @property
    def kind(self) -> Any:
        """The class of its kind."""
        return self.kinds[self.acts]

    @property
    def given(self) -> Any:
        """The value under its kind's key."""
        return getattr(self, self.acts)

    @property
    def vectors(self) -> list | None:
        """The vectors that it lists, one per load step; None where it lists none."""
        return self.given if self.kind.listed and isinstance(self.given[0], list) else None


class OnFaces(Acting):
    kinds = ON_FACES


class InVolumes(Acting):
    kinds = IN_VOLUMES


def _keys(kinds: Mapping[str, Any]) -> dict[str, Any]:
    """A model's keys, one for each kind."""
    return {name: (kind.takes | None, Field(None, description=kind.meaning))
            for name, kind in kinds.items()}


def _exactly_one(kinds: Mapping[str, Any], where: str) -> str:
    *first, last = kinds
    return f"Exactly one of {', '.join(first)} and {last}, {where}."


@cache
def _on_faces() -> type[Acting]:
    return create_model("BoundaryCondition", __base__=OnFaces, __module__=__name__,
                        __doc__=_exactly_one(ON_FACES, "on a place"),
                        on=(Where,
            Field(description="a surface group (shell wildcards allowed), a plane or a box")),
                        part=(Name | None, Field(None, description=(
            "name of the volume whose faces are meant, shell wildcards allowed; none: whichever "
            "has them"))), **_keys(ON_FACES),
                        frame=(Frame | None, Field(None, description=(
            "of a displacement, a traction or a foundation's stiffness: its components are "
            "radial, tangential and axial, {axis, at}"))),
                        history=(Name | None,
                 Field(None,
                       description="name of the factors per load step; none: the same at every "
                                   "step")))


@cache
def _in_volumes() -> type[Acting]:
    return create_model("BodyForce", __base__=InVolumes, __module__=__name__,
        __doc__=_exactly_one(IN_VOLUMES, "on the volumes it names; several add up"),
        on=(Names,
            Field(["*"],
                  description="names of volumes, shell wildcards allowed; * because weight acts "
                  "everywhere")),
        **_keys(IN_VOLUMES), history=(Name | None, Field(None, description=(
            "name of the factors per load step, of the force or the temperature; none: the same "
            "at every step"))))


def __getattr__(name: str) -> type[Acting]:
    """The two models by name: other processes find them so in what they are sent."""
    made = {"BoundaryCondition": _on_faces, "BodyForce": _in_volumes}.get(name)
    if made is None:
        raise AttributeError(name)
    return made()


Boundary = list[MadeModel(OnFaces, _on_faces).mapping]
Loads = list[MadeModel(InVolumes, _in_volumes).mapping]
Interfaces = list[ByName(Entry, "law", LAWS, lambda law: law.Parameters).mapping]


class Cut(Part):
    """A plane across a bolt's shank, or across any part."""

    plane: Axis = Field(
        description="its normal, of a bolt the axis: x, y, z, or a direction [x, y, z]")
    at: float | Vector = Field(
        description="coordinate of the plane along x, y or z; or a point on it")

    @property
    def point(self) -> list[float]:
        """A point on it."""
        return self.at if isinstance(self.at, list) else [self.at * (self.plane == name)
                                                          for name in "xyz"]


class Bolt(Part):
    """A bolt: cut across its shank, tightened by a force, then kept at its length."""

    vectors: ClassVar[None] = None  # per load step

    on: Name = Field(description="the name of its volume")
    cut: either(Literal["auto"], Cut, lambda value: isinstance(value, str),
                "auto, or {plane: z, at: 12}, or {plane: [0, 1, 1], at: [0, 5, 5]}") = Field(
                    "auto", description=(
        "plane across the shank, {plane: z, at: 12}; auto: at mid-length of the longest cylinder "
        "of the volume, moved into a plate where plates meet there"))
    force: Positive = Field(description="pretension, above 0")
    history: Name | None = Field(None, description=(
        "name of the factors per load step, of the force: while it is zero at the beginning the "
        "bolt is in place, and not tightened; none: tightened at the first step"))
    then: Literal["locked", "force"] = Field("locked", description=(
        "locked: from the load step after the last change of its history the bolt keeps its "
        "length; force: its force is what the history says at all load steps"))

    @property
    def law(self) -> Entry:
        """The law across the cut, as an entry of ``interfaces``."""
        return LAWS[BOLT_LAW].Parameters(law=BOLT_LAW, force=self.force, history=self.history,
                                         then=self.then)
