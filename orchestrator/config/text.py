"""From the text of a YAML file to plain data, and the line of every key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.constructor import ConstructorError, RoundTripConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import ScalarNode

from orchestrator.errors import InputError, KeyPath, Problem

TEXT, MERGE = "tag:yaml.org,2002:str", "tag:yaml.org,2002:merge"  # what a key is, and the one that stands for others
LARGEST = 20_000_000  # bytes, far above what ``MOST`` entries take: beyond, the file is something else
DEEPEST = 50  # levels; no configuration has more than ten
MOST = 100_000  # entries, those counted that aliases repeat: a few lines of aliases of aliases make thousands of millions


def read_text(path: Path) -> str:
    """The text of a configuration file.

    Raises InputError: no such file, none that can be read, or one larger than ``LARGEST``
    """
    try:
        if not path.is_file():
            raise InputError(Problem((), "a folder" if path.is_dir() else "no such file", "a YAML file",
                                     "check the path, or start from configs/traction_beam.yaml", str(path)))
        if (size := path.stat().st_size) > LARGEST:
            raise InputError(Problem((), f"{size / 1e6:.0f} MB", f"a YAML file, below {LARGEST / 1e6:.0f} MB",
                                     "name the configuration; meshes stand under mesh.file in it", str(path)))
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:  # of values: bytes that are no UTF-8, paths that no system takes
        raise InputError(Problem((), str(error), "a readable text file in UTF-8",
                                 "check the file's permissions and encoding", str(path))) from error


def parse_yaml(text: str, file: str) -> tuple[Any, dict[KeyPath, int]]:
    """Plain data of a YAML text and the line of every path in it.

    Raises InputError: bad syntax, a key given twice, more levels than ``DEEPEST`` or entries than ``MOST``
    """
    reader, lines = YAML(), {}
    reader.Composer, reader.Constructor = _Composer, _Constructor
    try:
        return _Plain(lines).of(reader.load(text), ()), lines
    except _TooMuch as error:
        raise InputError(Problem((), *error.args, file, max(lines.values(), default=1))) from None
    except _Twice as error:
        raise InputError(Problem((), error.problem, "every key once in its mapping", "remove one of the two",
                                 file, error.problem_mark.line + 1)) from error
    except YAMLError as error:
        mark = (error.problem_mark or error.context_mark) if isinstance(error, MarkedYAMLError) else None
        found = _first_line(getattr(error, "problem", None) or str(error))
        raise InputError(Problem((), found, "correct YAML", "check indentation, brackets and colons around this line",
                                 file, mark.line + 1 if mark else None)) from error


class _Composer(Composer):
    """Takes keys as they are written; refuses deep nesting where it stands, before Python runs out of stack."""

    _depth = 0

    def compose_mapping_node(self, anchor: Any) -> Any:
        """Keys are texts, quoted or not: 1 and "1" are one key, 1 and 1.0 are two, and none of them is a number."""
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for i, (key, value) in enumerate(node.value):
            if not isinstance(key, ScalarNode):
                raise MarkedYAMLError(problem="a list or a mapping for a key", problem_mark=key.start_mark)
            line = key.start_mark.line + 1
            if key.value in lines:
                raise _Twice(problem=f"duplicate key \"{key.value}\", on lines {lines[key.value]} and {line}", problem_mark=key.start_mark)
            lines[key.value] = line
            if key.tag != MERGE:
                node.value[i] = ScalarNode(TEXT, key.value, key.start_mark, key.end_mark, key.style, key.comment), value
        return node

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        try:
            if self._depth > DEEPEST:
                raise MarkedYAMLError(problem=f"more than {DEEPEST} levels of nesting",
                                      problem_mark=self.parser.peek_event().start_mark)
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


class _Constructor(RoundTripConstructor):
    """Says where a scalar stands that is none of its kind: a 13th month, a number of 5,000 digits."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep=deep)
        except (ValueError, ArithmeticError) as error:
            raise ConstructorError(problem=str(error).partition(";")[0], problem_mark=node.start_mark) from error


class _Twice(MarkedYAMLError):
    """A key that its mapping has already."""


class _TooMuch(Exception):
    """What was found, what is expected, and the cure."""


class _Plain:
    """Plain dicts, lists and numbers of a ruamel.yaml tree; notes the lines on the way."""

    def __init__(self, lines: dict[KeyPath, int]):
        self._lines, self._count = lines, 0

    def of(self, node: Any, path: KeyPath) -> Any:
        self._count += 1
        if self._count > MOST or len(path) > DEEPEST:
            raise _TooMuch(f"more than {MOST:,} entries" if self._count > MOST else f"more than {DEEPEST} levels of nesting",
                           f"at most {MOST:,} entries, {DEEPEST} levels deep, with what aliases (*name) repeat",
                           "write out what is meant, without aliases of aliases")
        if isinstance(node, dict):
            for key in node:
                if key in (node.lc.data or {}):  # keys merged from an anchor have no line of their own
                    self._lines[*path, key] = node.lc.key(key)[0] + 1
            return {str(key): self.of(value, (*path, key)) for key, value in node.items()}
        if isinstance(node, list):
            for index in node.lc.data or {}:
                self._lines[*path, index] = node.lc.item(index)[0] + 1
            return [self.of(value, (*path, index)) for index, value in enumerate(node)]
        for kind in (bool, int, float, str):
            if isinstance(node, kind):
                return kind(node)
        return node if node is None else str(node)


def _first_line(text: str) -> str:
    return text.strip().splitlines()[0]
