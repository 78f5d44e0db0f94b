"""What a study may be told: ``--set key=value``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, PositiveInt, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from orchestrator import InputError, Problem


class Keys(BaseModel):
    """What may be set of a study, as fields; other keys are refused."""

    model_config = ConfigDict(extra="forbid")


class RandomScenes(Keys):
    """What to draw, and who solves it."""

    scenes: PositiveInt = Field(60, description="random scenes")
    first: int = Field(1, ge=0, description="number of the first one; scenes are drawn from their numbers")
    code: str = Field("freefem", description="the code that solves the bodies")


def arguments(name: str, function: Callable[..., None], overrides: Sequence[str]) -> dict[str, Any]:
    """What the study's function is called with beside the study: nothing that has not been asked for.

    Parameters
    ----------
    name : of the study
    function : with a parameter ``settings``, whose default is a ``Keys``, if there is something to set

    Raises
    ------
    InputError : it has no settings, or not these
    """
    if not overrides:
        return {}
    known = inspect.signature(function).parameters
    if "settings" not in known:
        raise InputError(Problem((), f"--set {overrides[0]}", f"nothing: the study {name} has no settings", "leave it out"))
    return {"settings": _settings(type(known["settings"].default), overrides)}


def _settings(model: type[Keys], overrides: Sequence[str]) -> Keys:
    data = {}
    for text in overrides:
        key, sign, value = text.partition("=")
        if not sign or key not in model.model_fields:
            near = get_close_matches(key, model.model_fields, 1)
            raise InputError(Problem((), f"--set {text}", "key=value, of the keys " + ", ".join(model.model_fields),
                                     f"did you mean '{near[0]}'?" if near else "take one of these"))
        try:
            data[key] = YAML(typ="safe").load(value)
        except YAMLError as error:
            raise InputError(Problem((), f"--set {text}", "a value in YAML", str(error))) from error
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError([Problem((), f"--set {'.'.join(map(str, e['loc']))}: {e['input']!r}", e["msg"], "give another value")
                          for e in error.errors()]) from error
