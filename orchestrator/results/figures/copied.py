"""A copy of this process that does one thing while the process itself goes on: charts, while surfaces are drawn."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

PATIENCE = 10.0  # seconds after which a copy that does not end is ended: what it does takes tenths of one


class Copied:
    """Begins at once, where the system can copy processes; whatever goes wrong there is done again here.

    For processes whose other threads hold nothing that the work needs, such as the one that draws.

    Parameters
    ----------
    work : what writes files, and returns nothing
    """

    def __init__(self, work: Callable[[], object]):
        self._work, self._process = work, 0
        if hasattr(os, "fork") and len(os.sched_getaffinity(0)) > 1:
            self._process = os.fork()
            if not self._process:
                self._end()

    def finish(self) -> None:
        """Waits for the end; raises what the work raises."""
        if not self._process or not self._ended():
            self._work()

    def _end(self) -> None:
        """In the copy: the work, and no clearing up after what is not its own."""
        status = 1
        try:
            self._work()
            status = 0
        finally:
            os._exit(status)

    def _ended(self) -> bool:
        """Whether the copy has done its work."""
        begin = time.monotonic()
        while True:
            process, status = os.waitpid(self._process, os.WNOHANG)
            if process:
                return status == 0
            if time.monotonic() - begin > PATIENCE:
                os.kill(self._process, signal.SIGKILL)
                os.waitpid(self._process, 0)
                return False
            time.sleep(0.002)
