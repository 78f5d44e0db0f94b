"""The codes there are, and the black box a configuration asks for.

A new code is a new module and one line in ``CODES``; a solver of one's own in Python needs not even that.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from orchestrator.blackbox.codes.calculix import CalculiX
from orchestrator.blackbox.codes.freefem import FreeFem
from orchestrator.blackbox.codes.python_code import PythonCode, scikit_fem
from orchestrator.blackbox.pool.worker import Code
from orchestrator.errors import InputError

CODES: dict[str, Callable[[], Code]] = {"freefem": FreeFem, "calculix": CalculiX, "scikit-fem": scikit_fem}
TRANSPORTS = ("pipe", "file")
NAMES = f"one of {', '.join(CODES)}, or file.py, file.py:Class, package.module:Class"


class Settings(Protocol):
    """The ``blackbox`` section of a configuration. ``timeout``: seconds one answer may take."""

    code: str
    element: str
    transport: str
    workers: int | str
    timeout: float


def code_named(name: str) -> Callable[[], Code] | None:
    """What makes a code: one of ``CODES``, or a class as file.py, file.py:Class or package.module:Class; None for others."""
    if name in CODES:
        return CODES[name]
    where = name.rpartition(":")[0]
    if where or name.endswith(".py"):
        return partial(PythonCode, Path(where or name).name, name)
    return None


def others() -> list[str]:
    """A line for each code beside FreeFEM, which no run needs unless it names it."""
    lines = []
    for name in (name for name in CODES if name != "freefem"):
        try:
            lines.append(f"{name}: {CODES[name]().version()}")
        except InputError as error:
            lines.append(f"no {name} (optional): {error.problems[0].cure}")
    return lines
