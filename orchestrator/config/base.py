"""What all parts of the configuration share: strictness and the few composite types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

# Marks the alternative of a union in pydantic's error locations; what follows is the sentence
# shown to the user. No YAML key can start with it.
TAG = "\0"


class Part(BaseModel):
    """One mapping of the YAML. Unknown keys, converted types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


def either(first: Any, second: Any, is_first: Callable[[Any], bool], expected: str) -> Any:
    """A union of two types, decided by ``is_first(value)``, so that errors concern one of them.

    Parameters
    ----------
    first, second : types
    is_first : function of the raw value (or of the validated one) → bool
    expected : what is accepted, as shown to the user
    """
    one, two = f"{TAG}1{expected}", f"{TAG}2{expected}"
    return Annotated[Annotated[first, Tag(one)] | Annotated[second, Tag(two)],
                     Discriminator(lambda value: one if is_first(value) else two)]


def auto_or(number: Any, expected: str) -> Any:
    """The word ``auto`` or a number."""
    return either(Literal["auto"], number, lambda value: isinstance(value, str), f"auto, or {expected}")


def one_or_per_step(vector: Any, expected: str) -> Any:
    """A vector, or a list of vectors, one per load step."""
    several = Annotated[list[vector], Field(min_length=1)]
    return either(several, vector,
                  lambda value: isinstance(value, list) and bool(value) and isinstance(value[0], list),
                  expected)


def as_list(value: Any) -> Any:
    """A single name stands for a list of one."""
    return [value] if isinstance(value, str) else value


Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
PartlyFree = Annotated[list[float | None], Field(min_length=3, max_length=3)]
Sizes = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Counts = Annotated[list[Count], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1)]
