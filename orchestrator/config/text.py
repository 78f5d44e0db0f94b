"""Plain data from the text of a YAML file, with the line of every key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from orchestrator.errors import InputError, KeyPath, Problem

MERGE = "tag:yaml.org,2002:merge"  # the key that stands for those of another mapping
# bytes, far above what ``MOST`` entries take: beyond, the file is something else
LARGEST = 20_000_000
DEEPEST = 50  # levels; no configuration has more than ten
# entries, those counted that aliases repeat: a few lines of aliases of aliases make thousands of
# millions
MOST = 100_000


def read_text(path: Path) -> str:
    """The text of a configuration file. Raises InputError where no such file, none that can be
    read, or one larger than ``LARGEST``.
    """
    try:
        if not path.is_file():
            raise InputError(Problem((), "a folder" if path.is_dir() else "no such file",
                                     "a YAML file",
                                     "check the path, or start from configs/traction_beam.yaml",
                                     str(path)))
        if (size := path.stat().st_size) > LARGEST:
            raise InputError(Problem((), f"{size / 1e6:.0f} MB",
                                     f"a YAML file, below {LARGEST / 1e6:.0f} MB",
                                     "name the configuration; meshes stand under mesh.file in it",
                                     str(path)))
        return path.read_text(encoding="utf-8")
    # of values: bytes that are no UTF-8, paths that no system takes
    except (OSError, ValueError) as error:
        raise InputError(Problem((), str(error), "a readable text file in UTF-8",
                                 "check the file's permissions and encoding", str(path))) from error


def parse_yaml(text: str, file: str) -> tuple[Any, dict[KeyPath, int]]:
    """Plain data of a YAML text and the line of every path in it. Raises InputError for bad syntax,
    a key given twice, more levels than
    ``DEEPEST`` or entries than ``MOST``."""
    reader, lines = YAML(typ="safe", pure=True), {}
    reader.Composer = _Composer
    try:
        node = reader.compose(text)
        return None if node is None else _Plain(reader.constructor, file).of(node, (), lines), lines
    except YAMLError as error:
        mark = (error.problem_mark or error.context_mark) if isinstance(
            error, MarkedYAMLError) else None
        found = (getattr(error, "problem", None) or str(error)).strip().splitlines()[0]
        raise InputError(Problem((), found, "correct YAML",
                                 "check indentation, brackets and colons around this line",
                                 file, mark.line + 1 if mark else None)) from error


class _Composer(Composer):
    """Refuses deep nesting where it stands, before Python runs out of stack."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        try:
            if self._depth > DEEPEST:
                raise MarkedYAMLError(problem=f"more than {DEEPEST} levels of nesting",
                                      problem_mark=self.parser.peek_event().start_mark)
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


class _Plain:
    """Plain dicts, lists and scalars of YAML's nodes; notes the lines on the way. Keys are texts,
    quoted or not: 1 and "1" are one key, 1
    and 1.0 are two, and none of them is a number."""

    def __init__(self, constructor: SafeConstructor, file: str):
        self._constructor, self._file, self._count = constructor, file, 0

    def of(self, node: Node, path: KeyPath, lines: dict[KeyPath, int]) -> Any:
        self._count += 1
        if self._count > MOST or len(path) > DEEPEST:
            raise InputError(Problem((), f"more than {MOST:,} entries" if self._count > MOST
                                     else f"more than {DEEPEST} levels of nesting",
                                     f"at most {MOST:,} entries, {DEEPEST} levels deep, with what "
                                     "aliases (*name) repeat",
                                     "write out what is meant, without aliases of aliases",
                                     self._file, node.start_mark.line + 1))
        if isinstance(node, MappingNode):
            return self._mapping(node, path, lines)
        if isinstance(node, SequenceNode):
            lines |= {(*path, i): entry.start_mark.line + 1 for i, entry in enumerate(node.value)}
            return [self.of(entry, (*path, i), lines) for i, entry in enumerate(node.value)]
        if node.tag.rpartition(":")[2] not in ("bool", "int", "float", "null"):
            return node.value  # dates are no numbers
        try:
            return self._constructor.construct_object(node)
        except (ValueError, ArithmeticError) as error:  # a number of 5,000 digits
            raise MarkedYAMLError(problem=str(error).partition(";")[0],
                                  problem_mark=node.start_mark) from error

    def _mapping(self, node: MappingNode, path: KeyPath,
                 lines: dict[KeyPath, int]) -> dict[str, Any]:
        seen: dict[str, int] = {}
        own, merged = {}, {}
        for key, value in node.value:
            mark = key.start_mark
            if not isinstance(key, ScalarNode):
                raise MarkedYAMLError(problem="a list or a mapping for a key", problem_mark=mark)
            if key.value in seen:
                raise InputError(
                    Problem((),
                            f"duplicate key \"{key.value}\", on lines {seen[key.value]} and "
                            f"{mark.line + 1}",
                            "every key once in its mapping", "remove one of the two",
                            self._file, mark.line + 1))
            seen[key.value] = mark.line + 1
            if key.tag != MERGE:
                lines[*path, key.value] = mark.line + 1
                own[key.value] = self.of(value, (*path, key.value), lines)
                continue
            for one in value.value if isinstance(value, SequenceNode) else [value]:
                if not isinstance(one, MappingNode):
                    raise MarkedYAMLError(problem="<< of what is no mapping", problem_mark=mark)
                merged = self.of(one, path, {}) | merged  # these have no line of their own
        return merged | own
