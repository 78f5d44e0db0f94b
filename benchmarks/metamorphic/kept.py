"""Scenes that failed once, each in a file whose first line says how: ``# cut otherwise 7000006001: disagree``.

    python -m benchmarks.metamorphic.kept tests/scenes/*.yaml      judges them again
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml import YAML

from benchmarks.metamorphic.judge import Verdict, judge
from benchmarks.metamorphic.worker import use_tests_code


class Kept(NamedTuple):
    """A scene, the relation that it broke (or "itself"), and what that drew with."""

    data: dict[str, Any]
    relation: str
    number: int


def read(path: Path) -> Kept:
    """A file that the study or ``shrink`` has written."""
    text = path.read_text(encoding="utf-8")
    said = re.match(r"# (.+?) (\d+): ", text)
    if said is None:
        raise ValueError(f"{path}: the first line does not say which relation it broke")
    return Kept(YAML(typ="safe").load(text), said[1], int(said[2]))


def judged_again(path: Path) -> Verdict:
    """Of the scene under its relation."""
    kept = read(path)
    return judge(kept.data, [] if kept.relation in ("itself", "in one piece") else [kept.relation], kept.number)


def main() -> None:
    use_tests_code()
    for path in map(Path, sys.argv[1:]):
        verdict = judged_again(path)
        print(path, verdict.outcome, verdict.said[:300],
              *(f"{k}: {v} ({verdict.details[k]})" for k, v in verdict.tried.items()), sep="\n  ")


if __name__ == "__main__":
    main()
