"""Functions compiled to machine code at their first call, and kept for the next process.

For loops over node pairs or blocks that numpy could only do by writing large arrays between one pass and the next. The
compiler is numba; it is imported by the first call of a function that has not been compiled yet, see ``linked``. Without a linker (Debian:
binutils) every process that calls one imports it. The machine code is kept in the user's cache directory or in what ``NUMBA_CACHE_DIR``
names, beside the source where that may not be written; where nothing can be written each process compiles for itself, some seconds long.

Other threads run while such a function does. ``in_parts`` has several of them work on parts of long arrays: between two
questions to the codes their cores have nothing else to do.
"""

from __future__ import annotations

import fcntl
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, ExitStack, suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any

from orchestrator.linked import kind_of, load, make, name_of, NotLinked
from orchestrator.optional import check_there, need

# Sums may be formed in any order that the compiler likes, which is the same in every call; nan and inf stay what they are.
SUMS = {"reassoc", "contract"}
OPTIONS = {"nogil": True, "fastmath": SUMS}


class Compiled:
    """A function compiled at its first call, in which other threads may run.

    module, name : where it is: plain loops over arrays and numbers, in a module that imports nothing that numba does not know
    function : it, where the module is there; None: it is imported when it has to be compiled
    """

    def __init__(self, module: str, name: str, function: Callable[..., Any] | None = None):
        self.module, self.name, self._function = module, name, function
        self._known: dict[tuple, Callable[..., Any]] = {}
        self.__doc__ = function and function.__doc__

    def __call__(self, *arguments):
        kinds = tuple(map(kind_of, arguments))
        if (known := self._known.get(kinds)) is None:
            known = self._known[kinds] = self._learnt(kinds, arguments)
        return known(*arguments)

    @property
    def called(self) -> bool:
        """Whether it has been."""
        return bool(self._known)

    @property
    def function(self) -> Callable[..., Any]:
        """What is compiled."""
        if self._function is None:
            self._function = getattr(import_module(self.module), self.name).function
        return self._function

    def _learnt(self, kinds: tuple, arguments: tuple) -> Callable[..., Any]:
        """What to call for arguments of these kinds: a library that is kept, else the compiler's machine code."""
        try:
            source = Path(self._function.__code__.co_filename if self._function else find_spec(self.module).origin)
            path = kept_in() / f"{self.module}.{self.name}.{name_of(source, kinds)}.so"
            if not path.exists():
                with _one_compiles(path.with_suffix(".lock")):
                    if not path.exists():
                        make(path, self.function, arguments, OPTIONS)
            return load(path, arguments)
        except (NotLinked, OSError):  # no linker; the disk is full, say; no file holds it
            return self._by_compiler(arguments)

    def _by_compiler(self, arguments: tuple) -> Callable[..., Any]:
        machine = self._compiled(cache=True)
        try:
            with _one_compiles(kept_in() / f"{self.module}.{self.name}.lock"):
                machine.compile(tuple(map(need("numba").typeof, arguments)))
        except OSError:  # as above
            machine = self._compiled(cache=False)
        return machine

    def _compiled(self, cache: bool) -> Callable[..., Any]:
        numba = need("numba")
        with _PLACE:
            before, numba.core.config.CACHE_DIR = numba.core.config.CACHE_DIR, str(kept_in())
            try:
                return numba.njit(cache=cache, **OPTIONS)(self.function)
            except RuntimeError:  # no place for a cache
                return numba.njit(**OPTIONS)(self.function)
            finally:
                numba.core.config.CACHE_DIR = before


_PLACE = threading.Lock()  # numba's setting, which is for all of the process


@contextmanager
def _one_compiles(path: Path) -> Iterator[None]:
    """Other processes that want the same function at the same time, as ranks do, wait and find its machine code.

    Where no file can be locked, each compiles for itself."""
    need("numba")  # each process imports the compiler for itself
    with ExitStack() as stack:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(open(path, "w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def kept_in() -> Path:
    """The folder of machine code: it outlives the package, which may be installed where nobody can write."""
    asked = os.environ.get("NUMBA_CACHE_DIR")
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(asked or os.path.join(home, "latin-orchestrator"))


def compiled(function: Callable[..., Any]) -> Compiled:
    """Decorator: see ``Compiled``."""
    return Compiled(function.__module__, function.__name__, function)


def make_ready() -> None:
    """Import the compiler and have it set itself up in another thread: for when it will be needed, and something else comes
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
    """Results of ``function(start, stop, *arguments)`` for parts of ``range(size)``, in their order; on all cores.

    function : writes to entries of its own part alone
    part : how many of them, which take much longer than to hand them out; the same on any number of cores, so that sums are
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
