"""A process that draws, made ready while the run computes.

To import what draws and to open a window takes as long as the iterations of a small problem; and a graphics library
that finds no display may end its process: the run must survive that. This module imports next to nothing, so that
the process can be started before the run's own imports.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Thread

from orchestrator.parallel.launcher import without_launcher

PATIENCE = 300.0  # seconds after which the process is given up


class Artist:
    """The process; as a context manager it is ended on leaving. Where it fails, this process draws."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._waiting: Thread | None = None
        self._answer = b""
        with suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable, "-m", "orchestrator.results.figures.studio"], env=without_launcher(os.environ),
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                process_group=0)  # Ctrl-C is for the run, which then ends it

    def begin(self, draw: Callable[..., object], *job: object) -> Artist:
        """Has ``draw(*job, canvas=…)`` called there; returns this artist.

        Parameters
        ----------
        draw : a function of a module, whose ``canvas`` may be None: then matplotlib must do
        job : what can be pickled
        """
        self._draw, self._job = draw, job
        self._waiting = Thread(target=self._hand_over, args=[pickle.dumps((draw, job), pickle.HIGHEST_PROTOCOL)], daemon=True)
        self._waiting.start()
        return self

    def finish(self) -> object:
        """Waits for what the function returns.

        Raises
        ------
        InputError : from the function: disk full or folder not writable
        """
        self._waiting.join()
        if not self._answer:
            return self._draw(*self._job, canvas=None)
        result, error = pickle.loads(self._answer)
        if error is not None:
            raise error
        return result

    def _hand_over(self, work: bytes) -> None:
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired, OSError):  # OSError: it has ended before
                self._answer, _ = self._process.communicate(work, timeout=PATIENCE)
            self._process.kill()

    def close(self) -> None:
        """Ends the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            if self._waiting is None:
                self._process.communicate()
            else:
                self._waiting.join()
            self._process.wait()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def drawn(draw: Callable[..., object], *job: object) -> object:
    """What ``draw(*job, canvas=…)`` returns, called in a process of its own; parameters and errors as for ``Artist``."""
    with Artist() as artist:
        return artist.begin(draw, *job).finish()
