"""From the text of a YAML file to plain data, and the line of every key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from orchestrator.errors import InputError, KeyPath, Problem


def read_text(path: Path) -> str:
    """The text of a configuration file.

    Raises
    ------
    InputError : no such file, or none that can be read
    """
    if not path.is_file():
        raise InputError(Problem((), "a folder" if path.is_dir() else "no such file", "a YAML file",
                                 "check the path, or start from configs/traction_beam.yaml", str(path)))
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(Problem((), str(error), "a readable text file in UTF-8",
                                 "check the file's permissions and encoding", str(path))) from error


def parse_yaml(text: str, file: str) -> tuple[Any, dict[KeyPath, int]]:
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


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0]
