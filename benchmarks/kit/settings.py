"""What a study may be told: ``--set key=value`` and ``--resume``, checked like a configuration."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from pydantic import ValidationError

from orchestrator.config.explain import explained
from orchestrator.config.overrides import BadOverride, apply, parse
from orchestrator.config.text import parse_yaml
from orchestrator.errors import InputError, Problem


def arguments(name: str, function: Callable[..., None], overrides: Sequence[str], resume: bool) -> dict[str, Any]:
    """What the study's function is called with beside the study: nothing that has not been asked for.

    Parameters
    ----------
    name : of the study
    function : with a parameter ``settings``, whose default is a model, if there is something to set; with a parameter
        ``resume`` if it keeps its runs

    Raises
    ------
    InputError : it has no settings, or not these; it keeps no runs
    """
    known, result = inspect.signature(function).parameters, {}
    if overrides:
        if "settings" not in known:
            raise InputError(Problem((), f"--set {overrides[0]}", f"nothing: the study {name} has no settings", "leave it out"))
        result["settings"] = _settings(type(known["settings"].default), overrides)
    if resume:
        if "resume" not in known:
            raise InputError(Problem((), "--resume", f"nothing: the study {name} keeps no runs", "run it anew, without"))
        result["resume"] = True
    return result


def _settings(model: type, overrides: Sequence[str]) -> Any:
    data: dict[str, Any] = {}
    for text in overrides:
        try:
            data = apply(data, *parse(text, lambda value: parse_yaml(value, f"--set {text}")[0]))
        except BadOverride as error:
            raise InputError(replace(error.problem, file=f"--set {text}")) from error
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(explained(error, data, model)) from error
