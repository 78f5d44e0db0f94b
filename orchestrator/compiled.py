"""Functions compiled to machine code at their first call, and kept for the next process.

For loops over node pairs or blocks that numpy could only do by writing large arrays between one pass and the next. The
compiler is numba; it is imported by the first call of such a function, so that what calls none does without it. The
machine code is kept beside the source or, where that may not be written, in the user's cache directory or what
``NUMBA_CACHE_DIR`` names; where nothing can be written each process compiles for itself, some seconds long.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

# Sums may be formed in any order that the compiler likes, which is the same in every call; nan and inf stay what they are.
SUMS = {"reassoc", "contract"}


class Compiled:
    """A function compiled at its first call, in which other threads may run.

    Parameters
    ----------
    function : plain loops over arrays and numbers, in a module that imports nothing that numba does not know
    """

    def __init__(self, function: Callable[..., Any]):
        self.function, self._machine = function, None
        self.__doc__ = function.__doc__

    def __call__(self, *arguments):
        if self._machine is None:
            self._machine = self._compiled(cache=True)
            try:
                return self._machine(*arguments)
            except OSError:  # the disk is full, say
                self._machine = self._compiled(cache=False)
        return self._machine(*arguments)

    def _compiled(self, cache: bool) -> Callable[..., Any]:
        import numba

        try:
            return numba.njit(nogil=True, cache=cache, fastmath=SUMS)(self.function)
        except RuntimeError:  # no place for a cache
            return numba.njit(nogil=True, fastmath=SUMS)(self.function)


def compiled(function: Callable[..., Any]) -> Compiled:
    """Decorator: see ``Compiled``."""
    return Compiled(function)
