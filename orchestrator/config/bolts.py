"""``bolts``: where they are cut, and the force that tightens them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from orchestrator.config.base import Name, Part, Positive, Vector, either
from orchestrator.config.entry import Entry
from orchestrator.config.turning import Axis
from orchestrator.registry import BOLT_LAW, LAWS


class Cut(Part):
    """A plane across a bolt's shank."""

    plane: Axis = Field(description="its normal, the axis of the bolt: x, y, z, or a direction [x, y, z]")
    at: float | Vector = Field(description="coordinate of the plane along x, y or z; or a point on it")

    @property
    def point(self) -> list[float]:
        """A point on it."""
        return self.at if isinstance(self.at, list) else [self.at * (self.plane == name) for name in "xyz"]


Where = either(Literal["auto"], Cut, lambda value: isinstance(value, str), "auto, or {plane: z, at: 12}, or {plane: [0, 1, 1], at: [0, 5, 5]}")


class Bolt(Part):
    """A bolt: cut across its shank, tightened by a force, then kept at its length."""

    on: Name = Field(description="the name of its volume")
    cut: Where = Field("auto", description=(
        "plane across the shank, {plane: z, at: 12}; auto: at mid-length of the longest cylinder of the volume"))
    force: Positive = Field(description="pretension, above 0")
    history: Name | None = Field(None, description=(
        "name of the factors per load step, of the force: while it is zero at the beginning the bolt is in place, and not "
        "tightened; none: tightened at the first step"))
    then: Literal["locked", "force"] = Field("locked", description=(
        "locked: from the load step after the last change of its history the bolt keeps its length; force: its force is "
        "what the history says at all load steps"))

    @property
    def law(self) -> Entry:
        """What holds across the cut, as an entry of ``interfaces``."""
        return LAWS[BOLT_LAW].Parameters(law=BOLT_LAW, force=self.force, history=self.history, then=self.then)
