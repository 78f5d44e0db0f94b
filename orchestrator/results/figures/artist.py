"""A process that draws, made ready while the run computes.

To import what draws and to open a window takes as long as the iterations of a small problem; and a graphics library that finds no
display may end its process: the run must survive that. This module imports next to nothing before ``main``, so that the process can
be started before the run's own imports.

    python -m orchestrator.results.figures.artist < JOBS > ANSWER

JOBS are pickled pairs of a function and its arguments, one after the other; ANSWER is the pickled pair of what they returned, and an
InputError of one of them.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread

from orchestrator.parallel.launcher import without_launcher

PATIENCE = 300.0  # seconds after the last job from which the process is given up


class CannotDraw(Exception):
    """The process has ended without an answer, or has been given up."""


class Artist:
    """The process; as a context manager it is ended on leaving."""

    def __init__(self) -> None:
        self._work: SimpleQueue[bytes | None] = SimpleQueue()
        self._answer, self._process = b"", None
        with suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__], env=without_launcher(os.environ), stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, process_group=0)  # Ctrl-C is for the run, which then ends it
        self._thread = Thread(target=self._hand_over, daemon=True)  # pipes hold less than a job
        self._thread.start()

    def begin(self, draw: Callable[..., object], *job: object) -> None:
        """Has ``draw(*job)`` called there, after earlier jobs; the function is one of a module, and all that is pickled."""
        self._work.put(pickle.dumps((draw, job), pickle.HIGHEST_PROTOCOL))

    def finish(self) -> list[object]:
        """Waits for what the functions return, but not for ever.

        Raises CannotDraw: the process crashes, as where VTK finds neither a display, EGL nor OSMesa, or takes longer than ``PATIENCE``
        Raises InputError: from a function: disk full or folder not writable
        """
        self._work.put(None)
        self._thread.join(PATIENCE)
        if late := self._thread.is_alive():
            self.close()
        if late or not self._answer:
            raise CannotDraw(f"the process that draws was not done after {PATIENCE:g} s" if late else "VTK cannot draw on this machine")
        results, error = pickle.loads(self._answer)
        if error is not None:
            raise error
        return results

    def _hand_over(self) -> None:
        if self._process is not None:
            with suppress(OSError):  # it has ended before
                while (work := self._work.get()) is not None:
                    self._process.stdin.write(work)
                    self._process.stdin.flush()
            with suppress(OSError, ValueError):
                self._answer, _ = self._process.communicate()

    def close(self) -> None:
        """Ends the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._work.put(None)
            self._thread.join()
            self._process.wait()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def drawn(draw: Callable[..., object], *job: object) -> object:
    """What ``draw(*job)`` returns, called in a process of its own; errors as from ``Artist.finish``."""
    with Artist() as artist:
        artist.begin(draw, *job)
        return artist.finish()[0]


def main() -> None:
    """Gets ready, does its jobs, ends."""
    import atexit
    import gc
    import resource

    gc.disable()  # a few jobs, then the end
    atexit.register(gc.freeze)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    with os.fdopen(os.dup(1), "wb") as answer:
        os.dup2(2, 1)  # what libraries print is no answer
        from orchestrator.errors import InputError
        from orchestrator.results.figures.figures import warm_up

        warm_up()
        results, error = [], None
        with suppress(EOFError):
            while error is None:
                draw, job = pickle.load(sys.stdin.buffer)
                try:
                    results.append(draw(*job))
                except InputError as its:
                    error = its
        pickle.dump((results, error), answer)


if __name__ == "__main__":
    main()
