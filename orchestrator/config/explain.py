"""Problems that a user can act on, from pydantic's errors."""

from __future__ import annotations

import difflib
import json
import re
from typing import Any, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from orchestrator.config.base import SIGNS, TAG, UNKNOWN_NAME, ByName, Chosen, Part, mappings
from orchestrator.config.model import Config
from orchestrator.config.paths import get
from orchestrator.errors import KeyPath, Problem

KINDS = {"float": "a number", "int": "a whole number", "string": "text", "bool": "true or false",
         "list": "a list", "dict": "a mapping (key: value)", "model": "a mapping (key: value)"}
_COMMA, _DIGITS = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?",
                             re.IGNORECASE), re.compile(r"\d+(e[+-]?\d+)?", re.IGNORECASE)


def explained(error: ValidationError, data: Any, root: type[Part] = Config) -> list[Problem]:
    """One problem per error, with the path in the YAML; ``data`` is what was validated, by the
    model ``root``.
    """
    return [_explain(entry, data, root) for entry in error.errors(include_url=False)]


def echo(value: Any) -> str:
    """A value as it would stand in the YAML, shortened, with its type when that helps."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def _explain(entry: Any, data: Any, root: type[Part]) -> Problem:
    kind, context = entry["type"], entry.get("ctx", {})
    path: KeyPath = tuple(key for key in entry["loc"] if not str(key).startswith(TAG))
    parent, _, chooser = _meet(path[:-1], data, root)
    model, field, _ = _meet(path, data, root)
    about = field.description or "" if field else ""
    named = [key for key in path if not isinstance(key, int)]
    hint = f"{named[-1]}: {about}" if about else ""
    keys = list(parent.model_fields) if parent else []
    if kind == "missing":
        return Problem(path, f"no {path[-1]}", about or "a value", f"add {path[-1]}")
    if kind == "extra_forbidden":
        if chooser and (owners := chooser.owners(str(path[-1]))):
            return _foreign(path, chooser.name(get(data, *path[:-1])), chooser.key, owners)
        known = chooser.keys() if isinstance(chooser, ByName) else keys
        return Problem(path, f"unknown key '{path[-1]}'", "one of " + ", ".join(keys),
                       _comma(path, data) or instead(str(path[-1]), known)
                       or nearest(str(path[-1]), known))
    if kind == UNKNOWN_NAME:
        return Problem(path, echo(entry["input"]), context["expected"],
                       nearest(str(entry["input"]), context["known"], otherwise=hint))
    if kind == "literal_error" and not _tagged(entry):
        options = [str(option).lower() if option is True else str(option)
                   for option in _options(field and field.annotation)]
        # no misspelling: it cannot be otherwise, and the description says why
        if len(options) == 1:
            return Problem(path, echo(entry["input"]), options[0], hint)
        return Problem(path, echo(entry["input"]), "one of " + ", ".join(options),
                       nearest(str(entry["input"]), options, otherwise=hint))
    return Problem(path, echo(entry["input"]), _expected(entry, kind, context, model),
                   _comma(path, data) or hint)


def _comma(path: KeyPath, data: Any) -> str:
    """The cure of a decimal comma: ``1,5`` as a text, or in brackets as ``1`` and a key or an entry
    ``5``.
    """
    value = get(data, *path)
    if isinstance(value, str) and _COMMA.fullmatch(value.strip()):
        return _mended("", *value.strip().split(","))
    beside = get(data, *path[:-1]) if path else None
    if isinstance(beside, dict) and value is None and _DIGITS.fullmatch(str(path[-1])):
        before = list(beside).index(path[-1]) - 1 if path[-1] in beside else -1
        whole = list(beside.items())[before] if before >= 0 else None
        if whole and isinstance(whole[1], int) and not isinstance(whole[1], bool):
            return _mended(f"{whole[0]}: ", whole[1], path[-1])
    return ""


def _mended(key: str, whole: object, rest: object) -> str:
    """The cure for a number in two parts, whose comma begins decimals or parts thousands."""
    if len(str(rest)) == 3 and str(rest).isdigit():
        return f"write {key}{whole}{rest}, or {key}{whole}.{rest} if these are decimals"
    return f"write {key}{whole}.{rest}: decimals follow a point"


def _expected(entry: Any, kind: str, context: dict, model: type[Part] | None) -> str:
    if bound := next((key for key in SIGNS if key in context), ""):
        return f"a number {SIGNS[bound]} {context[bound]:g}"
    if _tagged(entry):
        return str(entry["loc"][-1])[len(TAG) + 1:]
    if kind in ("too_short", "too_long"):
        bound, count = ("at least",
                        context["min_length"]) if kind == "too_short" else (
                            "at most", context["max_length"])
        return f"a list of {bound} {count} " + ("entry" if count == 1 else "entries")
    if kind == "finite_number":
        return "a finite number"
    if kind.endswith("_type") and (stem := kind.removesuffix("_type")) in KINDS:
        return KINDS[stem] + (" with " + ", ".join(model.model_fields) if model
                              and stem in ("model", "dict") else "")
    return {"string_too_short": "a text that is not empty",
            "string_pattern_mismatch": "letters, digits, '-', '_', '.' and spaces"}.get(
                kind, entry["msg"])


def nearest(word: str, options: list[str], otherwise: str = "remove it") -> str:
    """A cure: the known word closest to an unknown one, if any is close."""
    close = difflib.get_close_matches(word.lower(), options, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else otherwise


def _tagged(entry: Any) -> bool:
    """Whether the error concerns a whole alternative of a union, whose tag says what is
    expected.
    """
    return bool(entry["loc"]) and str(entry["loc"][-1]).startswith(TAG)


def _foreign(path: KeyPath, name: str, key: str, owners: list[str]) -> Problem:
    """The problem with a key that other names than the mapping's own know."""
    return Problem(path, f"{path[-1]} with {key}: {name}",
                   f"{path[-1]} with {key}: {' or '.join(owners)} only",
                   f"remove {path[-1]}, or write {key}: {owners[0]}")


def _meet(path: KeyPath, data: Any,
          root: type[Part]) -> tuple[type[Part] | None, FieldInfo | None, Chosen | None]:
    """The model a path leads to, if it leads to one, the last field met on the way, and what
    chooses the model, if it is chosen.
    """
    model: type[Part] | None = root
    field: FieldInfo | None = None
    chooser: Chosen | None = None
    for end, key in enumerate(path, 1):
        if isinstance(key, int):
            continue  # the entries of a list share one field
        if model is None or key not in model.model_fields:
            return None, field, None
        field = model.model_fields[key]
        end += end < len(path) and isinstance(path[end], int)
        found = [one for _, one in mappings(field.annotation, field.metadata)]
        chooser, value = next((one for one in found if isinstance(one, Chosen)),
                              None), get(data, *path[:end])
        # of a union the first one that knows most of them
        known = value.keys() if isinstance(value, dict) else ()
        model = chooser.model(value) if chooser else max(
            found, key=lambda one: sum(key in one.model_fields for key in known), default=None)
    return model, field, chooser


def _options(annotation: Any) -> list[Any]:
    """The words that the Literals in a type accept."""
    return [word for part in get_args(annotation)
            for word in ([part] if isinstance(part, (str, bool)) else _options(part))]


# ---- keys that other programs have and this one has not ------------------------------------------

# Words → what to do. None of them is a key of this program's own, in whatever mapping.
_WORDS: dict[str, str] = {
    "rx ry rz rotation": "write an entry of boundary with motion: {rotate: {axis: z, degrees: "
                         "0.1, about: [0, 0, 0]}}",
    "moment torque total_force remote_force remote_load":
        "write an entry of boundary with resultant: {force: [0, 0, 1], moment: [0, 0, 0], about: "
        "[0, 0, 0]}",
    "coupling remote_displacement rigid_body rbe2 rbe3 remote_point":
        "write an entry of boundary with coupling: {about: [0, 0, 40], displacement: [0, null, "
        "null], force: [0, 10, 0]}",
    "foundation spring springs bedding elastic_support elastic_foundation winkler":
        "write an entry of boundary with foundation: {normal: 1.0e4}, force per area and per "
        "length",
    "preload bolt_pretension bolt_load": "write an entry of bolts: [{on: bolt_1, force: 8000}]",
    "symmetry symmetric symmetry_plane roller slider": "write symmetry: true in an entry of "
                                                       "boundary, on a plane across an axis",
    "antisymmetry periodic cyclic cyclic_symmetry":
        "not supported; periodic and cyclic bodies are modelled whole, or cut along planes of "
        "symmetry",
    "temperature expansion thermal thermal_expansion alpha heat conductivity initial_temperature":
        "write expansion: in materials and loads: [{on: plate, temperature: 80}]; how heat "
        "spreads plays no part",
    "weight rho acceleration mass gravity density":
        "write loads: [{gravity: [0, 0, -9810]}], with density: 7.85e-9 in materials (steel in t, "
        "mm, s)",
    "centrifugal rotational_speed omega": "write loads: [{spin: {axis: z, rate: 314}}], radians "
                                          "per time, with density: in materials",
    "hydrostatic hydrostatic_pressure": "write pressure: {at: [0, 0, 10], gradient: [0, 0, "
                                        "-9.81e-6]} in an entry of boundary",
    "contact contact_pair contacts":
        "not supported here; contact is a law between parts: interfaces: [{between: [a, b], law: "
        "contact, friction: 0.2}]",
    "tie mpc constraint glue": "not supported; parts are tied where they share faces: interfaces: "
                               "[{between: [a, b], law: perfect}]",
    "time time_step dt duration dynamic damping frequency eigenvalue amplitude initial_condition "
    "velocity load_step":
        "not supported; there is no time, only load steps: histories: {ramp: [0.5, 1.0]}, with "
        "history: ramp on the entries",
    "plasticity plastic yield yield_stress hardening creep hyperelastic orthotropic anisotropic "
    "shear_modulus bulk_modulus":
        "not supported; matter is linear and isotropic: {young: 200e3, poisson: 0.3}",
    "nonlinear_geometry nlgeom large_displacement large_deformation large_strain buckling":
        "not supported; displacements are small and matter is linear, the interfaces' laws alone "
        "are not",
    "plane_stress plane_strain axisymmetric axisymmetry":
        "not supported; two dimensions are a slab of one row of elements, its faces held along "
        "their normal for plane strain",
    "shell truss cross_section": "not supported; bodies are solid tetrahedra",
    "fixed clamped clamp encastre fix support dirichlet ux uy uz":
        "write displacement: [0, 0, 0] in an entry of boundary; null leaves a component free",
    "force point_load nodal_force neumann line_load":
        "write traction: [0, 0, 1], force per area, pressure: 1, or resultant: {force: [0, 0, "
        "1]}, in an entry of boundary",
}
_OTHER_NAMES = {"e": "young", "youngs_modulus": "young", "young_modulus": "young",
                "elastic_modulus": "young", "nu": "poisson",
                "poissons_ratio": "poisson", "poisson_ratio": "poisson", "material": "materials",
                "bcs": "boundary",
                "bc": "boundary", "boundary_conditions": "boundary", "solver": "method",
                "geometry": "mesh"}


def _plain(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_").replace("'", "").rstrip("s")


_CURES = {_plain(word): cure for words, cure in _WORDS.items() for word in words.split()}
_NAMES = {_plain(word): name for word, name in _OTHER_NAMES.items()}


def instead(word: str, keys: list[str]) -> str:
    """The cure for an unknown key that other programs have; empty where the word is none of those.

    keys : those that are known where the word stands; near misspellings of them are not foreign
    """
    plain = _plain(word)
    if (name := _NAMES.get(plain)) in keys:
        return f"write {name}"
    if plain in _CURES and plain not in map(_plain, keys):
        return _CURES[plain]
    return ""
