"""The model read out: as a JSON schema for editors that complete and check as one types, and as a
reference in Markdown.

What is said of a key stands in the model alone: messages, schema and reference repeat it.
"""

from __future__ import annotations

import json
import types
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BeforeValidator, Tag
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from orchestrator.config.base import SIGNS, TAG, Chosen, Part, mappings
from orchestrator.config.model import Config

HEAD = """# Every key

*Written by `orchestrator schema --keys` from the model that configurations are checked \
against. An entry of a list is
meant where a heading ends with `[]`; "none" is what holds where a key without a default is left \
out.*
"""
WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


def schema() -> str:
    """The JSON schema as text: keys, types, bounds, descriptions. Rules that concern several keys
    are ``check``'s alone. An entry that names a law or a code is any of their models; a solver of
    one's own takes any keys."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema",
            "$comment": "written by: orchestrator schema > configs/schema.json"}
    return json.dumps({**head, **Config.model_json_schema()}, indent=1, ensure_ascii=False) + "\n"


@dataclass(frozen=True)
class KeySection:
    """A mapping of the YAML: where it stands, which of several it is, and the model of its keys."""

    path: str
    kind: str
    model: type[Part]

    @property
    def title(self) -> str:
        return self.path + (f", {self.kind}" if self.kind else "")


def reference() -> str:
    """The reference as Markdown, a section for each mapping, a row for each key."""
    parts = [HEAD]
    for section in sections():
        about = (section.model.__doc__ or "").split("\n\n")[0].strip()
        parts.append("\n".join([f"## {section.title}", "", " ".join(about.split()), "",
                                "| key | takes | default | meaning |", "|---|---|---|---|",
                                *(row(name, field)
                                  for name, field in section.model.model_fields.items())]) + "\n")
    return "\n".join(parts)


def sections() -> list[KeySection]:
    """All mappings, each before those inside it; a model that stands in several places is told at
    the first.
    """
    found: list[KeySection] = []
    told: set[type[Part]] = set()

    def tell(section: KeySection) -> None:
        if section.model in told:
            return
        told.add(section.model)
        found.append(section)
        for name, field in section.model.model_fields.items():
            path = name if section.model is Config else f"{section.path}.{name}"
            for suffix, inside in mappings(field.annotation, field.metadata):
                for kind, model in inside.shipped().items() if isinstance(inside, Chosen) else [
                    ("", inside)]:
                    tell(KeySection(path + suffix, f"{inside.key}: {kind}" if kind else "", model))

    tell(KeySection("the whole", "", Config))
    return found


def row(name: str, field: FieldInfo) -> str:
    """One key: what it takes, its default, its meaning; of names that stand for models, the meaning
    says which.
    """
    default = "**required**" if field.is_required() else f"`{plain(field)}`" if plain(
        field) is not None else "none"
    return (
        f"| `{name}` | {cell(takes([field.annotation, *field.metadata]))} | {default} | "
        f"{cell(field.description or '')} |")


def plain(field: FieldInfo) -> str | None:
    """The default as YAML writes it; None where there is none, or where it is a mapping that has a
    section.
    """
    value = field.get_default(call_default_factory=False) if field.default_factory is None else None
    if value is None or value is PydanticUndefined or isinstance(value, Part):
        return None
    return str(value).lower() if isinstance(value, bool) else str(value).replace("'", "")


def takes(notes: list[Any]) -> str:
    """The values that a type accepts, in words."""
    kind, others = notes[0], notes[1:]
    if any(isinstance(note, Chosen) for note in others):
        return "a mapping"
    for note in others:
        if isinstance(note,
                      BeforeValidator) and note.json_schema_input_type is not PydanticUndefined:
            return takes([note.json_schema_input_type])
    inner, origin = get_args(kind), get_origin(kind)
    if origin is Annotated:
        return takes([*inner, *others])
    if origin in (Union, types.UnionType):  # the sentence that its messages say, where it has one
        tags = (note.tag for part in inner for note in get_args(part)[1:] if isinstance(note, Tag))
        sentence = next((tag[len(TAG) + 1:] for tag in tags if tag.startswith(TAG)), "")
        return sentence or " or ".join(dict.fromkeys(takes([part]) for part in inner
                                                     if part is not type(None)))
    if origin is Literal:
        return " or ".join(f"`{str(word).lower() if isinstance(word, bool) else word}`"
                           for word in inner)
    if origin is list:  # and how long it is where that is fixed
        least, most = (next((getattr(note, key) for note in flat(others) if hasattr(note, key)), 0)
                       for key in ("min_length", "max_length"))
        entry = takes([inner[0]])
        return f"{least} × {entry}" if least and least == most else "a list of " + entry.replace(
            "a mapping", "mappings")
    if origin is dict:
        return f"a mapping of names to {takes([inner[1]])}"
    if isinstance(kind, type) and issubclass(kind, Part):
        return "a mapping"
    bounds = dict.fromkeys(f"{sign} {getattr(note, key):g}" for note in flat(others)
                           for key, sign in SIGNS.items() if hasattr(note, key))
    return WORDS.get(kind, "anything") + (" " + ", ".join(bounds) if bounds else "")


def flat(notes: list[Any]) -> list[Any]:
    """Constraints, those inside a field's own among them."""
    return [*notes, *(extra for note in notes for extra in getattr(note, "metadata", []))]


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
