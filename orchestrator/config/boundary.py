"""``boundary``, ``loads`` and ``interfaces``: what acts on the body and between its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, create_model

from orchestrator.config.base import ByName, Name, Names, Part, Vector, either
from orchestrator.config.entry import Entry
from orchestrator.config.turning import Axis, unit
from orchestrator.registry import IN_VOLUMES, LAWS, ON_FACES


class Place(Part):
    """Boundary faces on a plane, or inside a box."""

    plane: Literal["x", "y", "z"] | None = Field(None, description="axis normal to the plane; comes with `at`")
    at: float | None = Field(None, description="coordinate of the plane along that axis")
    box: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = Field(
        None, description="lower and upper corner: [[x, y, z], [x, y, z]]")


Where = either(Place, Name, lambda value: isinstance(value, (dict, Place)),
               "the name of a surface group, {plane: x, at: 0}, or {box: [[0, 0, 0], [1, 1, 1]]}")


class Frame(Part):
    """Cylindrical directions about an axis: radial, tangential and axial, right-handed."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    at: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")

    @property
    def direction(self) -> list[float]:
        """Of the axis, of length one."""
        return unit(self.axis)


def _keys(kinds: Mapping[str, Any]) -> dict[str, Any]:
    """Of a model, a key for each kind."""
    return {name: (kind.takes | None, Field(None, description=kind.meaning)) for name, kind in kinds.items()}


def _listed(kinds: Mapping[str, Any]) -> str:
    *first, last = kinds
    return f"{', '.join(first)} and {last}"


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
        """What stands under its kind's key."""
        return getattr(self, self.acts)


class OnFaces(Acting):
    kinds = ON_FACES


class InVolumes(Acting):
    kinds = IN_VOLUMES


BoundaryCondition = create_model(
    "BoundaryCondition", __base__=OnFaces, __module__=__name__, __doc__=f"Exactly one of {_listed(ON_FACES)}, on a place.",
    on=(Where, Field(description="a surface group (shell wildcards allowed), a plane or a box")), **_keys(ON_FACES),
    frame=(Frame | None, Field(None, description=(
        "of a displacement, a traction or a foundation's stiffness: its components are radial, tangential and axial, {axis, at}"))),
    history=(Name | None, Field(None, description="name of the factors per load step; none: the same at every step")))

BodyForce = create_model(
    "BodyForce", __base__=InVolumes, __module__=__name__,
    __doc__=f"Exactly one of {_listed(IN_VOLUMES)}, on the volumes it names; several add up.",
    on=(Names, Field(["*"], description="names of volumes, shell wildcards allowed; * because weight acts everywhere")),
    **_keys(IN_VOLUMES), history=(Name | None, Field(None, description=(
        "name of the factors per load step, of the force or the temperature; none: the same at every step"))))


Interfaces = list[ByName(Entry, "law", LAWS, lambda law: law.Parameters).mapping]


def everything_perfect() -> list[Entry]:
    """Default of ``interfaces``."""
    return [Entry()]
