"""The black box a configuration asks for: the codes are checked, then started."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

from orchestrator.blackbox.codes.registry import NAMES, TRANSPORTS, Settings, code_named
from orchestrator.blackbox.layers.routed import Routed
from orchestrator.blackbox.pool.pool import Pool, default_workers
from orchestrator.errors import InputError, KeyPath, Problems


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
