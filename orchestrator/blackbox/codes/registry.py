"""The codes there are, and the black box a configuration asks for.

A new code is a new module and one line in ``CODES``; a solver of one's own in Python needs not even that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

from orchestrator.blackbox.codes.calculix import CalculiX
from orchestrator.blackbox.layers.compliance import Compliance
from orchestrator.blackbox.codes.freefem import FreeFem
from orchestrator.blackbox.pool.pool import Pool, default_workers
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.blackbox.codes.python_code import PythonCode, scikit_fem
from orchestrator.blackbox.layers.routed import Routed
from orchestrator.blackbox.layers.shared import SharedModels
from orchestrator.blackbox.pool.worker import Code
from orchestrator.errors import InputError, KeyPath, Problems
from orchestrator.savings import Savings

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


def make_blackbox(settings: Settings | Sequence[Settings], used: Iterable[int] | None = None) -> Pool | Routed:
    """Check that the codes are there, then start them.

    Parameters
    ----------
    settings : one, or the entries of a list, to which ``Model.code`` refers
    used : which entries of a list have a model; default all

    Raises InputError for unknown codes, elements or transports and for a code that is not installed
    (nothing has been started then), BlackBoxError when its processes do not start.
    """
    if not isinstance(settings, Sequence):
        return _prepared(settings, ("blackbox",))()
    starters = _all_prepared(settings, range(len(settings)) if used is None else used)
    if len(settings) == 1:
        return starters[0]()
    pools: dict[int, Pool] = {}
    try:
        for index, start in starters.items():
            pools[index] = start()
    except BaseException:
        for pool in pools.values():
            pool.close()
        raise
    return Routed(pools)


def check_codes(settings: Sequence[Settings], used: Iterable[int]) -> None:
    """Check the entries of a list that have a model as ``make_blackbox`` does, and start nothing."""
    _all_prepared(settings, used)


def _all_prepared(settings: Sequence[Settings], used: Iterable[int]) -> dict[int, Callable[[], Pool]]:
    """Per entry that is used, what starts its pool; raises InputError with the problems of all."""
    problems, starters = [], {}
    for index in sorted(set(used)) or [0]:
        try:
            starters[index] = _prepared(settings[index], ("blackbox", index) if len(settings) > 1 else ("blackbox",))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return starters


def _prepared(settings: Settings, path: KeyPath) -> Callable[[], Pool]:
    """What starts the pool; raises InputError."""
    problems = Problems()
    make = code_named(settings.code)
    if make is None:
        problems.add((*path, "code"), repr(settings.code), NAMES)
    if settings.transport not in TRANSPORTS:
        problems.add((*path, "transport"), repr(settings.transport), f"one of {', '.join(TRANSPORTS)}")
    workers = default_workers() if settings.workers == "auto" else settings.workers
    if not isinstance(workers, int) or workers < 1:
        problems.add((*path, "workers"), repr(settings.workers), "auto or a number from 1 on")
    problems.raise_if_any()
    try:
        code = make()
    except InputError as error:  # a code knows nothing of lists
        raise InputError([replace(p, path=(*path, *p.path[1:])) for p in error.problems]) from error
    if settings.element not in code.elements:
        problems.add((*path, "element"), repr(settings.element), f"one of {', '.join(code.elements)}")
    if settings.transport not in code.transports:
        problems.add((*path, "transport"), f"{settings.transport} with {code.name}, which ends after every run",
                     f"one of {', '.join(code.transports)}", f"write transport: {next(iter(code.transports))}")
    problems.raise_if_any()
    timeout = float(getattr(settings, "timeout", 600.0))
    return partial(Pool, code.transports[settings.transport], code, settings.element, workers, timeout)


def spared(blackbox: BlackBox, skip, workers: int, steps: int, savings: Savings) -> BlackBox:
    """The black box with the layers that save it work.

    Parameters
    ----------
    skip : ``method.skip`` of a configuration: congruent, repeated, compliance
    workers : processes behind the black box
    steps : load steps that are solved together
    savings : where what is saved is noted
    """
    if skip.compliance:
        blackbox = Compliance(blackbox, workers=workers, savings=savings)
    return SharedModels(blackbox, congruent=skip.congruent, repeated=skip.repeated, workers=workers, steps=steps,
                        savings=savings)
