"""Programs that are started, of which nothing is left running whatever happens; and the memory of
this one.
"""

from __future__ import annotations

import atexit
import ctypes
import math
import os
import resource
import shutil
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, IO

from orchestrator.errors import wrong

TAIL = 2000  # bytes of what a program printed last

_running: set[subprocess.Popen] = set()
# so that whoever ends all meets one that has just begun; a signal may interrupt its holder
_starting = threading.RLock()
_watched: list[Any] = []  # pools, which have ``kill`` and ``close``
# of MPI's variables
_PREFIXES = ("OMPI_", "PMI_", "PMIX_", "PRTE_", "MV2_", "HYDRA_", "HYDI_", "MPI_LOCAL")


def without_launcher(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a code that is no part of the parallel run, even if it was built with
    MPI.
    """
    return {name: value for name, value in environment.items() if not name.startswith(_PREFIXES)}


def started(command: Sequence[str], env: Mapping[str, str] = os.environ,
            **options: Any) -> subprocess.Popen:
    """Start a program in a group of its own, which Ctrl-C does not reach; the kernel kills it with
    the thread that calls this. Of a
    parallel run it knows nothing.

    options : as of ``subprocess.Popen``
    """
    if setpriv := shutil.which("setpriv"):
        command = [setpriv, "--pdeathsig", "KILL", *command]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, process_group=0,
                            env=without_launcher(env), **options)


def end(process: subprocess.Popen) -> None:
    """Kill a program and whatever it has started: it may be a script around others."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def waited_for(command: Sequence[str], patience: float, **options: Any) -> int:
    """Starts a program and waits for its end: its exit code, or minus the signal that has ended it.
    Raises OSError where it cannot be
    started, subprocess.TimeoutExpired where it was ended after ``patience`` seconds."""
    with _starting:
        process = started(command, **options)
        _running.add(process)
    try:
        return process.wait(patience)
    finally:
        end(process)
        process.wait()
        _running.discard(process)


def end_all() -> None:
    """End all that are waited for now; from any thread."""
    with _starting:
        for process in list(_running):
            end(process)


def watch(pool: Any) -> None:
    """Close the pool when the program ends, and on SIGTERM. A handler of SIGTERM that the program
    set itself is respected.
    """
    _watched.append(pool)
    _handle(signal.SIG_DFL, _terminated)


def forget(pool: Any) -> None:
    """The pool is closed."""
    if pool in _watched:
        _watched.remove(pool)
    if not _watched:
        _handle(_terminated, signal.SIG_DFL)


def _handle(before: object, after: object) -> None:
    if threading.current_thread() is threading.main_thread() and signal.getsignal(
        signal.SIGTERM) is before:
        signal.signal(signal.SIGTERM, after)


def _terminated(number: int, frame: object) -> None:
    for pool in list(_watched):
        pool.kill()
    # end the way the sender expects
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)


@atexit.register
def _at_exit() -> None:
    for pool in list(_watched):
        pool.close()


def memory_peak_mb(pid: int | str = "self") -> float:
    """Largest resident memory a process has had, in MB; nan when the process is gone or not on
    Linux.
    """
    try:
        # not getrusage: its maximum survives exec and shows the parent's memory
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024 / 1e6
    except (OSError, StopIteration):
        return math.nan


def trim() -> None:
    """Give free memory back to the system: after set-up a sixth of what 207,000 dofs take at the
    peak. Where the C library is GNU's.
    """
    libc("malloc_trim", 0)


def last_words(log: IO[bytes]) -> str:
    """Return the last that a program printed; the offset, which it may share, stays."""
    begin = max(0, os.fstat(log.fileno()).st_size - TAIL)
    return os.pread(log.fileno(), TAIL, begin).decode(errors="replace").strip()


def libc(name: str, *values: int) -> None:
    """Call a function of the C library, where it is GNU's."""
    with suppress(OSError, AttributeError):
        getattr(ctypes.CDLL("libc.so.6"), name)(*values)


# addresses that libraries, their threads and the buffers of BLAS take on two cores, however small
# the problem
NEEDED = 1_200_000_000


def check_addresses() -> None:
    """Before OpenBLAS is at work: it waits for ever, without a word, for a buffer that a limit does
    not allow.

    Raises InputError: the limit of this process's addresses is below what any run takes
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < NEEDED:
        raise wrong((), f"at most {limit / 1e6:,.0f} MB of addresses for a process (ulimit -v)",
                    f"{NEEDED / 1e6:,.0f} MB: libraries and their threads take as much, however "
                    "small the problem",
                    "ulimit -v unlimited, or a higher limit")
