"""Tutorials, to be followed to the letter: their files and their commands.

A fence below a line that ends with "`name`:" is a file. A ``console`` fence holds commands, behind ``$``, each with lines of
what it prints.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

_FENCE = re.compile(r"(?:^`([\w./]+)`[^\n]*:\n+)?^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def followed(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Every command of a tutorial and the lines that it shows below; the files above it are then written, in this folder."""
    for name, language, text in _FENCE.findall(path.read_text(encoding="utf-8")):
        if name:
            Path(name).write_text(text, encoding="utf-8")
            Path(name).chmod(0o755 if text.startswith("#!") else 0o644)
        elif language == "console":
            for command, *shown in [block.splitlines() for block in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]]:
                yield command, shown
