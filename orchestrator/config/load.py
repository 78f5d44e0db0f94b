"""From a YAML file and overrides to a validated configuration, or to all its problems at once."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from orchestrator.config.blackbox import CodeSettings, settings_class
from orchestrator.config.checks import broken_rules
from orchestrator.config.explain import echo, explained
from orchestrator.config.model import Config
from orchestrator.config.overrides import BadOverride, apply, parse
from orchestrator.config.paths import get
from orchestrator.errors import InputError, KeyPath, Problem

# Models that come with gmsh; the scene knows where they are.
SHIPPED = "gmsh:"


@dataclass(frozen=True)
class Source:
    """Where the keys of a configuration stand.

    Parameters
    ----------
    file : the YAML file as the user named it; empty for a configuration built in Python
    lines : path → line, counted from 1
    overrides : path → the text of the ``--set`` that gave it
    """

    file: str = ""
    lines: dict[KeyPath, int] = field(default_factory=dict)
    overrides: dict[KeyPath, str] = field(default_factory=dict)

    def locate(self, path: KeyPath) -> tuple[str, int | None]:
        """(file, line) of a key, or of its nearest parent; ("--set key=value", None) for an override."""
        for length in range(len(path), 0, -1):
            known = path[:length]
            if known in self.overrides:
                return f"--set {self.overrides[known]}", None
            if known in self.lines:
                return self.file, self.lines[known]
            for keys, text in self.overrides.items():  # a parent that only an override made
                if keys[:length] == known:
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


@dataclass(frozen=True)
class Loaded:
    """A valid configuration that remembers where it came from."""

    config: Config
    source: Source = field(default_factory=Source)

    def locate(self, path: KeyPath) -> tuple[str, int | None]:
        """(file, line) of a key, see ``Source.locate``."""
        return self.source.locate(path)


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> Loaded:
    """Reads and validates a configuration.

    Parameters
    ----------
    path : YAML file; ``mesh.file`` and ``mesh.step`` in it are relative to its folder, or to the current one
    overrides : ``key.key=value`` texts, values in YAML; applied in order

    Raises
    ------
    InputError : with all problems, each with file and line

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
    text = _read(Path(path))
    data, lines = _parse(text, str(path))
    source = Source(str(path), lines)
    problems: list[Problem] = []
    for override in overrides:
        try:
            keys, value = parse(override, lambda value: _parse(value, f"--set {override}")[0])
            data = apply(data, keys, value)
            source.overrides[keys] = override
        except BadOverride as error:
            problems.append(replace(error.problem, file=f"--set {override}"))
        except InputError as error:
            problems += error.problems
    data, missing = _find_meshes(data, Path(path).parent)
    data = _find_files_of_codes(data, Path(path).parent)
    try:
        config = config_from(data)
        problems += missing
    except InputError as error:
        problems += error.problems + missing
    if problems:
        raise InputError(source.located(problems))
    return Loaded(config, source)


def config_from(data: Any) -> Config:
    """Validates plain data, as a YAML file would hold it.

    Raises
    ------
    InputError : with all problems

    Examples
    --------
    >>> from orchestrator import config_from
    >>> bar = {
    ...     "name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [8, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 4}}, "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [10, 0, 0]}]}
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
        raise InputError(Problem((), found, "a mapping (key: value) with name, mesh, subdomains, materials and boundary",
                                 "start from configs/traction_beam.yaml"))
    problems: list[Problem] = []
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        problems = explained(error, data)
    # A misspelt key makes its mapping look incomplete too; the spelling is what to mend.
    misspelt = {problem.path[:-1] for problem in problems if problem.found.startswith("unknown key")}
    problems += [problem for problem in broken_rules(data) if problem.path not in misspelt]
    if problems:
        raise InputError(problems)
    return config


def settings_from(entry: dict[str, Any]) -> CodeSettings:
    """Validates one entry of ``blackbox`` by itself.

    Raises
    ------
    InputError : with all problems
    """
    model = settings_class(entry)
    try:
        return model.model_validate(entry)
    except ValidationError as error:
        raise InputError(explained(error, entry, model)) from error


def located(error: InputError, loaded: Loaded) -> InputError:
    """The same error with file and line filled in, for problems found after loading."""
    return InputError(loaded.source.located(error.problems))


def _read(path: Path) -> str:
    if not path.is_file():
        raise InputError(Problem((), "a folder" if path.is_dir() else "no such file", "a YAML file",
                                 "check the path, or start from configs/traction_beam.yaml", str(path)))
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(Problem((), str(error), "a readable text file in UTF-8",
                                 "check the file's permissions and encoding", str(path))) from error


def _parse(text: str, file: str) -> tuple[Any, dict[KeyPath, int]]:
    """Plain data of a YAML text and the line of every path in it.

    Raises
    ------
    InputError : bad syntax, or a key given twice
    """
    lines: dict[KeyPath, int] = {}
    try:
        return _plain(YAML().load(text), (), lines), lines
    except DuplicateKeyError as error:
        raise InputError(Problem((), _first_line(error.problem), "every key once in its mapping", "remove one of the two",
                                 file, error.problem_mark.line + 1)) from error
    except YAMLError as error:
        mark = (error.problem_mark or error.context_mark) if isinstance(error, MarkedYAMLError) else None
        found = _first_line(getattr(error, "problem", None) or str(error))
        raise InputError(Problem((), found, "correct YAML", "check indentation, brackets and colons around this line",
                                 file, mark.line + 1 if mark else None)) from error


def _plain(node: Any, path: KeyPath, lines: dict[KeyPath, int]) -> Any:
    """Plain dicts, lists and numbers of a ruamel.yaml tree; notes the lines on the way."""
    if isinstance(node, dict):
        for key in node:
            if key in (node.lc.data or {}):  # keys merged from an anchor have no line of their own
                lines[*path, str(key)] = node.lc.key(key)[0] + 1
        return {str(key): _plain(value, (*path, str(key)), lines) for key, value in node.items()}
    if isinstance(node, list):
        for index in node.lc.data or {}:
            lines[*path, index] = node.lc.item(index)[0] + 1
        return [_plain(value, (*path, index), lines) for index, value in enumerate(node)]
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node if node is None else str(node)


def _find_meshes(data: Any, folder: Path) -> tuple[Any, list[Problem]]:
    """Mesh files looked up beside the YAML file first, then in the current folder."""
    problems: list[Problem] = []
    for key in ("file", "step"):
        name = get(data, "mesh", key)
        if not isinstance(name, str) or not name:
            continue
        if key == "step" and name.startswith(SHIPPED):
            continue
        places = [os.path.normpath(folder / name), os.path.normpath(name)]
        found = next((place for place in places if os.path.isfile(place)), None)
        if found:
            data = {**data, "mesh": {**data["mesh"], key: found}}
        else:
            problems.append(Problem(("mesh", key), f"no file {' nor '.join(dict.fromkeys(places))}",
                                    "an existing file", "paths are relative to the YAML file's folder"))
    return data, problems


def _find_files_of_codes(data: Any, folder: Path) -> Any:
    """Files that the entries of ``blackbox`` name and that stand beside the YAML file, with their folder."""
    def found(entry: Any) -> Any:
        return settings_class(entry).beside(entry, folder) if isinstance(entry, dict) else entry

    entry = get(data, "blackbox")
    if entry is None:
        return data
    return {**data, "blackbox": [found(e) for e in entry] if isinstance(entry, list) else found(entry)}


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0]
