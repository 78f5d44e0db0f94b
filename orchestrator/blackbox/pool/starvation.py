"""A process that waits for memory which it will never get.

OpenBLAS asks for a buffer of 128 MiB again and again until it gets it: where the address space is limited (``ulimit -v``),
a process spins in the kernel for ever. It is told from one that works by three signs at once: a limit, less left than the
buffer needs, and most of its time spent in the kernel.
"""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path

BUFFER = 1 << 27  # bytes that OpenBLAS asks for
PATIENCE, KERNEL = 5.0, 0.5  # seconds of wall clock between two looks, share of the process's time that is the kernel's
BUSY = 0.05  # share of the wall clock that it takes at least: one that sleeps does not ask


class Starvation:
    """Looks at a process now and then.

    Parameters
    ----------
    pid : of the process
    """

    def __init__(self, pid: int):
        self.pid, self.looked = pid, time.monotonic()
        self.spent = self._seconds()

    def __call__(self) -> str:
        """What it waits for, in words; empty while it may work."""
        if time.monotonic() - self.looked < PATIENCE:
            return ""
        before, self.spent, self.looked = self.spent, self._seconds(), time.monotonic()
        user, kernel = (now - then for now, then in zip(self.spent, before))
        if not kernel > max(KERNEL * (user + kernel), BUSY * PATIENCE):
            return ""
        try:
            limit = resource.prlimit(self.pid, resource.RLIMIT_AS)[0]
            size = int(Path(f"/proc/{self.pid}/statm").read_text().split()[0]) * resource.getpagesize()
        except (OSError, ValueError):
            return ""  # it has just ended
        if limit == resource.RLIM_INFINITY or limit - size > BUFFER + (1 << 20):
            return ""
        return (f"it asks for memory in vain: its address space is limited to {limit / 1e6:.0f} MB, of which {size / 1e6:.0f} "
                "are in use (raise ulimit -v, use smaller subdomains, or fewer workers)")

    def _seconds(self) -> tuple[float, float]:
        """CPU seconds of the process itself and of the kernel for it."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            return 0.0, 0.0
        tick = os.sysconf("SC_CLK_TCK")
        return int(fields[11]) / tick, int(fields[12]) / tick
