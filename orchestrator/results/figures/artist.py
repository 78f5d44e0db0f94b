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
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread

from orchestrator.parallel.launcher import without_launcher

PATIENCE = 300.0  # seconds after which the process is given up, whatever it does
IDLE = 15.0  # seconds after which it is given up if it has used no processor: it is stopped, or waits for what never comes
_LOOK = 0.2  # seconds between two looks


class TooSlow(Exception):
    """The process has been given up."""


class Artist:
    """The process; as a context manager it is ended on leaving. Where it fails, this process draws."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._waiting: Thread | None = None
        self._jobs: list[tuple[Callable[..., object], tuple]] = []
        self._work: SimpleQueue[bytes | None] = SimpleQueue()
        self._answer = b""
        with suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "orchestrator.results.figures.studio"], env=without_launcher(os.environ),
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                process_group=0)  # Ctrl-C is for the run, which then ends it

    def prepare(self, draw: Callable[..., object], *job: object) -> Artist:
        """Has ``draw(*job, canvas=…)`` called there, for what it returns: the next one has it as ``prepared=…``.

        Parameters
        ----------
        draw : a function of a module, whose ``canvas`` may be None: then matplotlib must do
        job : what can be pickled
        """
        self._jobs.append((draw, job))
        self._work.put(pickle.dumps((draw, job), pickle.HIGHEST_PROTOCOL))
        if self._waiting is None:
            self._waiting = Thread(target=self._hand_over, daemon=True)
            self._waiting.start()
        return self

    def begin(self, draw: Callable[..., object], *job: object) -> Artist:
        """The same of the last one, whose result ``finish`` returns; returns this artist."""
        self.prepare(draw, *job)
        self._work.put(None)
        return self

    def finish(self) -> object:
        """Waits for what the function returns, but not for ever.

        Raises
        ------
        TooSlow : the process takes longer than ``PATIENCE``, or does nothing for ``IDLE``
        InputError : from the function: disk full or folder not writable
        """
        begin = active = time.monotonic()
        used = self._processor_time()
        while self._waiting.is_alive():
            self._waiting.join(_LOOK)
            now = time.monotonic()
            if (so_far := self._processor_time()) != used:
                used, active = so_far, now
            if self._waiting.is_alive() and max(now - begin - PATIENCE, now - active - IDLE) > 0:
                self.close()
                raise TooSlow(f"the process that draws did nothing for {IDLE:g} s" if now - active > IDLE else
                              f"the process that draws was not done after {PATIENCE:g} s")
        if not self._answer:
            return _one_after_another(self._jobs, None)
        result, error = pickle.loads(self._answer)
        if error is not None:
            raise error
        return result

    def _hand_over(self) -> None:
        if self._process is not None:
            with suppress(OSError):  # it has ended before
                while (work := self._work.get()) is not None:
                    self._process.stdin.write(work)
                    self._process.stdin.flush()
            with suppress(OSError):
                self._answer, _ = self._process.communicate()
            self._process.kill()

    def _processor_time(self) -> str | None:
        """Ticks that the process has computed, as the system writes them; None where it does not tell."""
        with suppress(OSError, AttributeError):
            with open(f"/proc/{self._process.pid}/stat") as file:
                return " ".join(file.read().rpartition(")")[2].split()[11:13])
        return None

    def close(self) -> None:
        """Ends the process if it still runs."""
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
            if self._waiting is None:
                self._process.communicate()
            else:
                self._work.put(None)
                self._waiting.join()
            self._process.wait()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _one_after_another(jobs: Sequence[tuple[Callable[..., object], tuple]], canvas: object) -> object:
    """What the last of these functions returns; each but the first is told what the one before it has returned."""
    result = None
    for number, (draw, job) in enumerate(jobs):
        result = draw(*job, canvas=canvas, **({"prepared": result} if number else {}))
    return result


def drawn(draw: Callable[..., object], *job: object) -> object:
    """What ``draw(*job, canvas=…)`` returns, called in a process of its own; parameters and errors as for ``Artist``."""
    with Artist() as artist:
        try:
            return artist.begin(draw, *job).finish()
        except TooSlow:
            return draw(*job, canvas=None)
