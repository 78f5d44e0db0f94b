"""A validated configuration, from a YAML file and overrides, or all of its problems at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from orchestrator.config.blackbox import CodeSettings, settings_class
from orchestrator.config.explain import echo, explained
from orchestrator.config.model import Config
from orchestrator.config.paths import apply, parse, places, with_files
from orchestrator.config.rules import broken_rules
from orchestrator.config.text import parse_yaml, read_text
from orchestrator.errors import InputError, KeyPath, Problem, wrong

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class KeyPlaces:
    """The places of a configuration's keys in its file.

    file : the YAML file as the user named it; empty for a configuration built in Python
    lines : path → line, counted from 1
    overrides : path → the text of the ``--set`` that gave it
    """

    file: str = ""
    lines: dict[KeyPath, int] = field(default_factory=dict)
    overrides: dict[KeyPath, str] = field(default_factory=dict)

    def locate(self, path: KeyPath) -> tuple[str, int | None]:
        """(file, line) of a key, or of its nearest parent; ("--set key=value", None) for an
        override.
        """
        for length in range(len(path), 0, -1):
            known = path[:length]
            if known in self.overrides:
                return f"--set {self.overrides[known]}", None
            if known in self.lines:
                return self.file, self.lines[known]
            # a parent that only an override made, and did not complete
            for keys, text in self.overrides.items():
                if keys[:length] == known and not _by_default(path):
                    return f"--set {text}", None
        return self.file, 1 if self.file else None

    def located(self, problems: Sequence[Problem]) -> list[Problem]:
        """The problems with file and line filled in where they are unknown, in the file's order."""
        found = []
        for problem in problems:
            if not problem.file:
                file, line = self.locate(problem.path)
                problem = replace(problem, file=file, line=line)
            found.append(problem)
        return sorted(found, key=lambda problem: problem.line or 0)


def _by_default(path: KeyPath) -> bool:
    """Whether a key has a default wherever its mapping has."""
    model, field = Config, None
    for key in path:
        field = getattr(model, "model_fields", {}).get(key)
        if field is None:
            return False
        model = field.annotation
    return field is not None and not field.is_required()


@dataclass(frozen=True)
class Loaded:
    """A valid configuration that remembers where it came from."""

    config: Config
    source: KeyPlaces = field(default_factory=KeyPlaces)

    def locate(self, path: KeyPath) -> tuple[str, int | None]:
        """(file, line) of a key, see ``KeyPlaces.locate``."""
        return self.source.locate(path)


def load_config(path: str | Path, overrides: Sequence[str] = (), edited: bool = False) -> Loaded:
    """Reads and validates a configuration.

    path : YAML file; ``mesh.file`` and ``mesh.step`` in it are relative to its folder, or to the
        current one
    overrides : ``key.key=value`` texts, values in YAML; applied in order; ``*`` for every entry of
        a list
    edited : comments must not say EDIT any more, as ``orchestrator init`` marks what it guesses
    Raises InputError: with all problems, each with file and line

    Examples
    --------
    >>> from pathlib import Path
    >>> from orchestrator import load_config
    >>> written = Path("bar.yaml").write_text('''
    ... name: bar
    ... mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}}
    ... subdomains: {slices: {axis: x, count: 4}}
    ... materials: [{young: 200e3, poisson: 0.3}]
    ... boundary:
    ...   - {on: xmin, displacement: [0, 0, 0]}
    ...   - {on: xmax, traction: [10, 0, 0]}
    ... ''')
    >>> loaded = load_config("bar.yaml", ["method.max_iterations=50"])
    >>> loaded.config.method.max_iterations
    50
    >>> loaded.locate(("materials", 0, "young"))
    ('bar.yaml', 5)
    """
    text = read_text(Path(path))
    data, lines = parse_yaml(text, str(path))
    source = KeyPlaces(str(path), lines)
    problems = placeholders(text, str(path)) if edited else []
    for override in overrides:
        try:
            keys, value = parse(override, lambda value: parse_yaml(value, f"--set {override}")[0])
            for place in places(data, keys):
                data = apply(data, place, value)
                source.overrides[place] = override
        except InputError as error:
            problems += [replace(problem, file=f"--set {override}") for problem in error.problems]
    data, missing = with_files(data, Path(path).parent)
    try:
        config = config_from(data)
        problems += missing
    except InputError as error:
        problems += error.problems + missing
    if problems:
        raise InputError(source.located(problems))
    return Loaded(config, source)


def placeholders(text: str, file: str) -> list[Problem]:
    """A problem for each line whose comment says EDIT."""
    return [Problem((), f"{found[1]}, a guess of orchestrator init", "what is meant",
                    "write it in this line, and take the word EDIT out", file, number)
            for number, line in enumerate(text.splitlines(), 1)
            if (found := re.search(r"(?<=#).*?\b(EDIT\b.*)", line))]


def config_from(data: Any) -> Config:
    """Validates plain data, as a YAML file would hold it.

    Raises InputError: with all problems

    Examples
    --------
    >>> from orchestrator import config_from
    >>> bar = {
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}},
    ...     "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]},
    ...                  {"on": "xmax", "traction": [10, 0, 0]}]}
    >>> config_from(bar).method.tolerance.error
    1e-06
    >>> config_from({**bar, "methd": {}})
    Traceback (most recent call last):
    orchestrator.errors.InputError: methd
      found:    unknown key 'methd'
      expected: one of ...
      cure:     did you mean 'method'?
    """
    if not isinstance(data, dict):
        found = "nothing" if data is None else echo(data)
        raise wrong((), found,
                    "a mapping (key: value) with name, mesh, subdomains, materials and boundary",
                    "start from configs/traction_beam.yaml")
    problems: list[Problem] = []
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        problems = explained(error, data)
    # A misspelt key makes its mapping look incomplete too; the spelling is what to mend.
    misspelt = {problem.path[:-1] for problem in problems
                if problem.found.startswith("unknown key")}
    problems += [problem for problem in broken_rules(data) if problem.path not in misspelt]
    if problems:
        raise InputError(problems)
    return config


def settings_from(entry: dict[str, Any]) -> CodeSettings:
    """Validates one entry of ``blackbox`` by itself; raises InputError with all problems."""
    model = settings_class(entry)
    try:
        return model.model_validate(entry)
    except ValidationError as error:
        raise InputError(explained(error, entry, model)) from error


def asked_of(path: Path, overrides: Sequence[str], ask: Callable[[Config], Answer],
             edited: bool = False) -> Answer:
    """Findings of ``ask`` on a configuration; its errors say where in the file they are."""
    loaded = load_config(path, overrides, edited)
    try:
        return ask(loaded.config)
    except InputError as error:
        raise located(error, loaded) from error


def located(error: InputError, loaded: Loaded) -> InputError:
    """Fill in an error's file and line, for problems found after loading."""
    return InputError(loaded.source.located(error.problems))
