"""Base of all parts of the configuration: strictness, the few composite types, axes and turns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import (AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field,
                      GetJsonSchemaHandler,
                      SerializeAsAny, Tag, WrapValidator, create_model)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from orchestrator.errors import KeyPath, Problem

# Marks the alternative of a union in pydantic's error locations; what follows is the sentence
# shown to the user. No YAML key can start with it.
TAG = "\0"
SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}  # pydantic's names of bounds
UNKNOWN_NAME = "unknown_name"  # pydantic's error type for a word that names nothing


class Part(BaseModel):
    """One mapping of the YAML. Unknown keys, converted types, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


def either(first: Any, second: Any, is_first: Callable[[Any], bool], expected: str) -> Any:
    """A union of two types, decided by ``is_first(value)``, so that errors concern one of them.

    is_first : function of the raw value (or of the validated one) → bool
    expected : what is accepted, as shown to the user
    """
    one, two = f"{TAG}1{expected}", f"{TAG}2{expected}"
    return Annotated[Annotated[first, Tag(one)] | Annotated[second, Tag(two)],
                     Discriminator(lambda value: one if is_first(value) else two)]


class Chosen:
    """A mapping whose model is found when a value is met: no module of the models is loaded before.
    Marks a field's type.

    base : model that all of them derive from
    """

    base: type[Part]
    key: str

    @property
    def mapping(self) -> Any:
        """The type of such a mapping, for a field of a model."""
        return Annotated[SerializeAsAny[self.base], WrapValidator(self.validated), self]

    def validated(self, value: Any, _: Any) -> Part:
        """The mapping, by its own model; null keys of other models count as absent."""
        if isinstance(value, self.base):
            return value
        model = self.model(value)
        if isinstance(value, dict):
            value = {key: entry for key, entry in value.items() if entry is not None
                     or key in model.model_fields or not self.owners(key)}
        return model.model_validate(value)

    def model(self, value: Any) -> type[Part]:
        """The model of a raw value."""
        raise NotImplementedError

    def shipped(self) -> dict[str, type[Part]]:
        """All models, by their names; an only one has none."""
        raise NotImplementedError

    def owners(self, key: str) -> list[str]:
        """The names whose models have a key of their own."""
        return []


@dataclass(frozen=True, eq=False)
class MadeModel(Chosen):
    """The model is made by ``make``, of the keys that a registry has."""

    base: type[Part]
    make: Callable[[], type[Part]]
    key = ""

    def model(self, value: Any = None) -> type[Part]:
        return self.make()

    def shipped(self) -> dict[str, type[Part]]:
        return {"": self.make()}

    def __get_pydantic_json_schema__(self, _: Any,
                                     handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return handler(self.make().__pydantic_core_schema__)


@dataclass(frozen=True, eq=False)
class ByKey(Chosen):
    """The model follows from a key that it alone has.

    registry : key → model; otherwise : the key of what has none of these
    """

    base: type[Part]
    registry: Any
    otherwise: str
    key = "kind"

    def model(self, value: Any) -> type[Part]:
        keys = (key for key in self.registry if isinstance(value, dict) and key in value)
        return self.registry[next(keys, self.otherwise)]

    def shipped(self) -> dict[str, type[Part]]:
        return self.registry.shipped()

    def __get_pydantic_json_schema__(self, _: Any,
                                     handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [handler(model.__pydantic_core_schema__)
                          for model in self.registry.values()]}


@dataclass(frozen=True, eq=False)  # a registry has no hash
class ByName(Chosen):
    """The model follows from what the mapping names.

    key : that names it; its default in ``base`` is what a mapping without one names
    registry : name → thing; model_of : thing → its model
    others : words for what else than a name the registry takes, if anything
    """

    base: type[Part]
    key: str
    registry: Any
    model_of: Callable[[Any], type[Part]]
    others: Callable[[], str] = str

    def name(self, value: Any) -> Any:
        """The name that a raw mapping gives."""
        default = self.base.model_fields[self.key].default
        return value.get(self.key, default) if isinstance(value, dict) else default

    def model(self, value: Any) -> type[Part]:
        """The model of a name; where it is unknown, one that says which are known."""
        if not isinstance(value, dict):
            return self.base
        name = self.name(value)
        if isinstance(name, str) and name in self.registry:
            return self.model_of(self.registry[name])
        loose = type(self.base.__name__, (self.base,), {"model_config": {"extra": "ignore"}})
        return create_model(self.base.__name__, __base__=loose, **{self.key: (
            Annotated[str, AfterValidator(self._refused)],
            Field(description=self.base.model_fields[self.key].description))})

    def shipped(self) -> dict[str, type[Part]]:
        return {name: self.model_of(thing) for name, thing in self.registry.shipped().items()}

    def owners(self, key: str) -> list[str]:
        return [name for name, thing in self.registry.items()
                if key in self.model_of(thing).model_fields]

    def keys(self) -> list[str]:
        """The keys that any of the names' models has."""
        return list(dict.fromkeys(k for thing in self.registry.values()
                                  for k in self.model_of(thing).model_fields))

    def _refused(self, name: str) -> str:
        expected = ", ".join(filter(None, [f"one of {', '.join(self.registry)}", self.others()]))
        raise PydanticCustomError(UNKNOWN_NAME, "an unknown name",
                                  {"known": list(self.registry), "expected": expected})

    def __get_pydantic_json_schema__(self, _: Any,
                                     handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Any of the names' models, each with its own name; where others are taken, any keys go
        with them.
        """
        default, forms = self.base.model_fields[self.key].default, []
        for name, thing in self.registry.items():
            named = {"properties": {self.key: {"const": name}},
                     **({} if name == default else {"required": [self.key]})}
            forms.append({"allOf": [handler(self.model_of(thing).__pydantic_core_schema__), named]})
        if self.others():
            other = {"type": "string", "not": {"enum": list(self.registry)}}
            forms.append({"type": "object", "properties": {self.key: other},
                          "required": [self.key]})
        return {"anyOf": forms}


def mappings(kind: Any, notes: Iterable[Any] = (),
             suffix: str = "") -> Iterator[tuple[str, Chosen | type[Part]]]:
    """Models inside a type with such notes, or what chooses them, each with what a path to it gets
    behind it.
    """
    if chosen := [note for note in notes if isinstance(note, Chosen)]:
        yield suffix, chosen[0]
    elif isinstance(kind, type) and issubclass(kind, Part):
        yield suffix, kind
    elif get_origin(kind) is Annotated:
        yield from mappings(kind.__origin__, kind.__metadata__, suffix)
    else:
        for inner in get_args(kind):
            yield from mappings(inner, (), suffix + "[]" * (get_origin(kind) is list))


def auto_or(number: Any, expected: str) -> Any:
    """The word ``auto`` or a number."""
    return either(Literal["auto"], number, lambda value: isinstance(value, str),
                  f"auto, or {expected}")


def one_or_per_step(vector: Any, expected: str) -> Any:
    """A vector, or a list of vectors, one per load step."""
    several = Annotated[list[vector], Field(min_length=1)]
    return either(several, vector, lambda value: isinstance(value, list) and bool(value)
                  and isinstance(value[0], list), expected)


def as_list(value: Any) -> Any:
    """A single name stands for a list of one."""
    return [value] if isinstance(value, str) else value


Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
PartlyFree = Annotated[list[float | None], Field(min_length=3, max_length=3)]
Sizes = Annotated[list[Positive], Field(min_length=3, max_length=3)]
AutoCount = auto_or(Count, "a whole number >= 1")
Counts = Annotated[list[Count], Field(min_length=3, max_length=3)]
Name = Annotated[str, Field(min_length=1)]
Names = Annotated[list[Name], BeforeValidator(as_list, json_schema_input_type=list[Name] | Name),
                  Field(min_length=1)]
Axis = either(Literal["x", "y", "z"], Vector, lambda value: isinstance(value, str),
              "x, y or z, or a vector of three numbers")


def unit(axis: str | list[float]) -> list[float]:
    """The direction of an axis, of length one."""
    if isinstance(axis, str):
        return [float(axis == name) for name in "xyz"]
    size = sum(x * x for x in axis) ** 0.5
    return [x / size for x in axis]


class Rotate(Part):
    """A turn about an axis, right-handed."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    degrees: float = Field(description="angle, right-handed about the axis")
    about: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")


class Frame(Part):
    """Cylindrical directions about an axis: radial, tangential and axial, right-handed."""

    axis: Axis = Field(description="x, y, z, or a direction [x, y, z]")
    at: Vector = Field([0.0, 0.0, 0.0], description="a point on the axis; the origin by default")

    @property
    def direction(self) -> list[float]:
        """The axis's direction, of length one."""
        return unit(self.axis)


def no_direction(path: KeyPath, axis: Any) -> Iterator[Problem]:
    """The problem of a raw axis of no length."""
    if isinstance(axis, list) and not any(axis):
        yield Problem(path, str(axis), "a direction: a vector other than zero",
                      "write axis: z, or [0, 0, 1]")
