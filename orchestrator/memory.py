"""Memory that is given back to the system, and addresses that a limit leaves."""

from __future__ import annotations

import ctypes
import resource
from contextlib import suppress

from orchestrator.errors import InputError, Problem


def trim() -> None:
    """What is free now goes back: after set-up a sixth of what 207,000 dofs take at the peak. Where the C library is GNU's."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)


NEEDED = 1_200_000_000  # addresses that libraries, their threads and the buffers of BLAS take on two cores, however small the problem


def check_addresses() -> None:
    """Before numpy is imported: OpenBLAS waits for ever, without a word, for a buffer that a limit does not allow.

    Raises InputError: the limit of this process's addresses is below what any run takes
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < NEEDED:
        raise InputError(Problem((), f"at most {limit / 1e6:,.0f} MB of addresses for a process (ulimit -v)",
                                 f"{NEEDED / 1e6:,.0f} MB: libraries and their threads take as much, however small the problem",
                                 "ulimit -v unlimited, or a higher limit"))
