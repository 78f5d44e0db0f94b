"""Memory that is given back to the system as soon as it is free, or kept at hand for the next array.

The C library takes large arrays from the system one by one and returns them when they are freed. Having freed one of some
size it keeps those up to that size from then on, to spare the system the trouble: right where the same arrays come and
go, iteration after iteration. In set-up and delivery they do not: there each of several ranks takes a quarter less at the
peak without, for a tenth more CPU seconds of the system's.
"""

from __future__ import annotations

import ctypes
import resource
from functools import cache

from orchestrator.errors import InputError, Problem

# mallopt(3): arrays of at least so many bytes are taken from the system
_THRESHOLD = -3
LARGE = 1 << 20  # from which a page fault per 4 kB is small beside the work on them, done once
LARGEST = 32 << 20  # what the C library itself comes to at most, on 64 bits


@cache
def _library() -> ctypes.CDLL | None:
    """The C library, if it is GNU's."""
    try:
        library = ctypes.CDLL("libc.so.6")
        return library if library.mallopt and library.malloc_trim else None
    except (OSError, AttributeError):
        return None


def trim() -> None:
    """What is free now goes back."""
    if (library := _library()) is not None:
        library.malloc_trim(0)


def give_back() -> None:
    """Free memory goes back now, and large arrays from now on when they are freed."""
    if (library := _library()) is not None:
        library.mallopt(_THRESHOLD, LARGE)
        library.malloc_trim(0)


def keep_at_hand(size: int) -> None:
    """Arrays of up to ``size`` bytes are kept for the next ones from now on; what is free now goes back."""
    if (library := _library()) is not None:
        library.mallopt(_THRESHOLD, min(max(size, LARGE), LARGEST))
        library.malloc_trim(0)


NEEDED = 1_200_000_000  # addresses that libraries, their threads and the buffers of BLAS take on two cores, however small the problem


def check_addresses() -> None:
    """Before numpy is imported: OpenBLAS waits for ever, without a word, for a buffer that a limit does not allow.

    Raises
    ------
    InputError : the limit of this process's addresses is below what any run takes
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < NEEDED:
        raise InputError(Problem((), f"at most {limit / 1e6:,.0f} MB of addresses for a process (ulimit -v)",
                                 f"{NEEDED / 1e6:,.0f} MB: libraries and their threads take as much, however small the problem",
                                 "ulimit -v unlimited, or a higher limit"))
