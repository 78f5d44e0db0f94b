"""Functions compiled to machine code at their first call, and kept for the next process.

For loops over node pairs or blocks that numpy could only do by writing large arrays between one
pass and the next. The compiler is numba; it is imported by the first call of such a function, so
that what calls none does without it. The machine code is kept in the user's cache directory or in
what ``NUMBA_CACHE_DIR`` names, beside the source where that may not be written; where nothing can
be written each process compiles for itself, some seconds long.

Other threads run while such a function does. ``in_parts`` has several of them work on parts of long
arrays: between two questions to the codes their cores have nothing else to do.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import cache, cached_property
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

from orchestrator.optional import check_there, need

# Sums may be formed in any order that the compiler likes, which is the same in every call; nan and
# inf stay what they are.
SUMS = {"reassoc", "contract"}
LOOPS = re.compile(rb"^@(compiled|numba\.)", re.MULTILINE)  # in modules that have some


class Compiled:
    """A function compiled at its first call, in which other threads may run.

    function : plain loops over arrays and numbers, in a module that imports nothing that numba does
        not know
    """

    compiling = False  # whether one of them is compiled at this moment

    def __init__(self, function: Callable[..., Any]):
        self.function, self.called, self.__doc__ = function, False, function.__doc__

    @cached_property
    def _machine(self) -> Callable[..., Any]:
        numba = need("numba")
        numba.core.config.CACHE_DIR = str(kept_in())
        try:
            machine = numba.njit(nogil=True, cache=True, fastmath=SUMS)(self.function)
        except RuntimeError:  # no place for a cache
            return numba.njit(nogil=True, fastmath=SUMS)(self.function)
        name = f"{self.function.__module__}.{self.function.__name__}"
        machine.compile = _alone(machine.compile, name)
        return machine

    def __call__(self, *arguments):
        if not self.called:
            Compiled.compiling = threading.current_thread() is threading.main_thread()
            try:
                self._machine.compile(tuple(map(need("numba").typeof, arguments)))
            except OSError:  # the disk is full, say
                self._machine = need("numba").njit(nogil=True, fastmath=SUMS)(self.function)
            Compiled.compiling, self.called = False, True
        return self._machine(*arguments)


compiled = Compiled  # the decorator


def _alone(compile_: Callable[..., Any], name: str) -> Callable[..., Any]:
    """``compile_``, by one process at a time: two that compile a function for other types would
    keep both under one name, and the next one would load machine code for the wrong types."""
    def alone(signature):
        with ExitStack() as stack:
            with suppress(OSError):  # nothing is kept where no file can be locked
                kept_in().mkdir(parents=True, exist_ok=True)
                lock = stack.enter_context(open(kept_in() / f"{name}.lock", "w"))
                fcntl.flock(lock, fcntl.LOCK_EX)
            return compile_(signature)
    return alone


def kept_in() -> Path:
    """The folder of machine code of these very loops: it outlives the package, which may be
    installed where nobody can write.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(os.environ.get("NUMBA_CACHE_DIR") or os.path.join(home, "latin-orchestrator"),
                made_of())


@cache
def made_of(package: Path = Path(__file__).parent) -> str:
    """A name for all that machine code depends on but the processor, of which the compiler takes
    care: Python, the compiler itself, and
    the text of every module with loops, which take along what they call."""
    texts = [text for path in sorted(package.rglob("*.py"))
             if LOOPS.search(text := path.read_bytes())]
    return hashlib.sha256(
        repr((sys.version, version("numba"), str(package), texts)).encode()).hexdigest()[:16]


def make_ready() -> None:
    """Import the compiler and have it set itself up in another thread: for when it will be needed,
    and something else comes
    first that leaves a core to it. Raises InputError: it is not installed."""
    check_there("numba")

    def start() -> None:
        with suppress(Exception):  # whoever needs it will meet that again
            _nothing(0)

    threading.Thread(target=start, name="compiler", daemon=True).start()


@compiled
def _nothing(number):
    return number


def in_parts(function: Compiled, size: int, *arguments, part: int) -> list:
    """Results of ``function(start, stop, *arguments)`` for parts of ``range(size)``, in their
    order; on all cores.

    function : writes to entries of its own part alone
    part : how many of them, which take much longer than to hand them out; the same on any number of
        cores, so that sums are
    """
    starts = range(0, size, part)
    if len(starts) <= 1:
        return [function(0, size, *arguments)]
    results: list = [None] * len(starts)
    left = count()
    if not function.called:  # it is compiled before several threads want it
        results[next(left)] = function(0, part, *arguments)

    def work() -> None:
        while (number := next(left)) < len(starts):
            results[number] = function(starts[number], min(starts[number] + part, size), *arguments)

    helpers = [_helpers().submit(work) for _ in range(min(cores(), len(starts)) - 1)]
    try:
        work()
    finally:
        for helper in helpers:
            helper.result()
    return results


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@cache
def _helpers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(1, cores() - 1), "parts")
