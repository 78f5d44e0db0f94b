"""An entry of ``interfaces:`` in the YAML, as far as it is the same for all laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from orchestrator.config.base import Name, Part, auto_or, either
from orchestrator.registry import DEFAULT_LAW

Two = Annotated[list[Name], Field(min_length=2, max_length=2)]
Between = either(Literal["auto"], Two, lambda value: isinstance(value, str), "auto, or a list of the names of two parts")
# In units of the local element size.
Tolerance = auto_or(Annotated[float, Field(gt=0, le=10)], "a number > 0, at most 10, in units of the element size")
RIGHT = 90.0  # degrees; faces that turn farther look away from each other


def scaled(value: Any, factor: float) -> Any:
    """A number, or a list of such, times a factor."""
    return [scaled(x, factor) for x in value] if isinstance(value, list) else factor * value


class Entry(Part):
    """The law between two parts; the last match wins. Each law derives its own, with its parameters."""

    per_step: ClassVar[tuple[str, ...]] = ()  # keys that may be lists of vectors, one per load step

    between: Between = Field(["*", "*"], description=(
        "names of the two parts, shell wildcards allowed, in either order; auto: whatever parts' faces lie on each other, "
        "with gaps as they are"))
    exclude: Annotated[list[Two], Field(min_length=1)] | None = Field(None, description=(
        "pairs of names that the entry does not mean, shell wildcards allowed: [[bolt*, washer]]"))
    slave: Name | None = Field(None, description=(
        "where meshes do not match, the part whose nodes carry the interface; none: the softer under bonds, the covered one, "
        "the coarser one, in this order"))
    tolerance: Tolerance = Field("auto", description=(
        "how far apart faces may be that are paired across meshes that do not match, in units of the element size there; "
        "auto: 0.1, from surface to surface where faces are curved"))
    angle: Annotated[float, Field(gt=0, le=RIGHT)] | None = Field(None, description=(
        "degrees by which such faces may be off looking straight at each other; none: 45"))
    law: Name = Field(DEFAULT_LAW, description="perfect: bonded, the undamaged body")

    history: Name | None = Field(None, description=(
        "name of the factors per load step, of what the law prescribes: a jump, a gap, a force; none: the same at every step"))

    @property
    def scaled(self) -> tuple[str, ...]:
        """The keys that a history multiplies; none where the law prescribes nothing."""
        return ()

    @classmethod
    def wrong_factors(cls, factors: Sequence[float]) -> tuple[str, str, str] | None:
        """What of a history the law cannot have: what was found, what is expected, the cure."""
        return None

    def at_steps(self, factors: Sequence[float]) -> list[Entry]:
        """The entry at every load step, its ``history`` multiplied in; empty where it is the same at all of them."""
        if self.history is None:
            return []
        return [self.model_copy(update={key: scaled(getattr(self, key), factor) for key in self.scaled}) for factor in factors]

    @property
    def vectors(self) -> list | None:
        """The vectors that it lists, one per load step; None where it lists none."""
        return next((given for key in self.per_step if isinstance((given := getattr(self, key))[0], list)), None)

    @property
    def found(self) -> bool:
        """Whether pairs are found rather than named."""
        return self.between == "auto"

    @property
    def pair(self) -> tuple[str, str]:
        """Patterns of the two parts' names."""
        return ("*", "*") if self.found else tuple(self.between)

    @property
    def apart(self) -> str:
        """The key that has the sides' distance read from the geometry; empty where they must touch."""
        return ""

    @property
    def reach(self) -> float | None:
        """How far apart sides are sought, a length; None: as the scene thinks fit."""
        return None

    @property
    def follows(self) -> bool:
        """Whether the sides are paired anew as they slide."""
        return False

    @property
    def fit(self) -> float:
        """How deep the sides may be inside each other before loading, a length."""
        return 0.0

    @classmethod
    def broken(cls, raw: dict[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        """Rules that concern several keys of the raw entry: key, what was found, what is expected, the cure."""
        return iter(())
