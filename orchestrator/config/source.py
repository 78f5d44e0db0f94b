"""Where the keys of a configuration stand: file and line, or the override that gave them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from orchestrator.errors import KeyPath, Problem


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
            for keys, text in self.overrides.items():  # a parent that only an override made, and did not complete
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
    from orchestrator.config.model import Config

    model, field = Config, None
    for key in path:
        field = getattr(model, "model_fields", {}).get(key)
        if field is None:
            return False
        model = field.annotation
    return field is not None and not field.is_required()
