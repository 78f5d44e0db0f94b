"""A process that draws, made ready while the run computes: a graphics library that finds no display may end its process."""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from multiprocessing.connection import Connection, Pipe
from threading import Thread

from orchestrator.errors import InputError
from orchestrator.optional import absent, command, DRAWING
from orchestrator.processes import without_launcher

PATIENCE = 300.0  # seconds after which the process is given up


class CannotDraw(Exception):
    """The process has ended without an answer, or has been given up."""


class Artist:
    """The process; as a context manager it is ended on leaving."""

    def __init__(self) -> None:
        self._connection, theirs = Pipe()
        self._process = self._sender = None
        self._asked = 0
        with suppress(OSError):  # no more processes are allowed: nobody ever answers
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(theirs.fileno())], pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=without_launcher(os.environ),
                process_group=0)  # Ctrl-C is for the run, which then ends it
        theirs.close()

    def begin(self, draw: Callable[..., object], *job: object) -> None:
        """Have ``draw(*job)`` called there, after what was asked before; the function is one of a module, and all is pickled now."""
        job = pickle.dumps((draw, job), pickle.HIGHEST_PROTOCOL), self._sender
        self._sender, self._asked = Thread(target=self._send, args=job, daemon=True), self._asked + 1
        self._sender.start()  # pipes hold less than a job

    def _send(self, job: bytes, before: Thread | None) -> None:
        if before is not None:
            before.join()
        with suppress(OSError):  # it has ended before
            self._connection.send_bytes(job)

    def finish(self) -> object:
        """The result of the last function that was asked for.

        Raises CannotDraw: the process crashes, as where VTK finds neither a display, EGL nor OSMesa, or takes longer than ``PATIENCE``
        Raises InputError: from the function: disk full or folder not writable
        """
        answer = None
        for _ in range(self._asked):
            if not self._connection.poll(PATIENCE):
                self.close()
                raise CannotDraw(f"the process that draws was not done after {PATIENCE:g} s")
            try:
                answer = self._connection.recv()
            except (EOFError, OSError):
                raise CannotDraw("VTK cannot draw on this machine") from None
            if isinstance(answer, InputError):
                raise answer
        return answer

    def close(self) -> None:
        """End the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def artist_for(figures: object) -> AbstractContextManager[Artist | None]:
    """The artist for what a configuration asks for: none where that is nothing, or the packages are not there (``no_figures``)."""
    return Artist() if figures and not absent(*DRAWING) else nullcontext()


def no_figures() -> list[str]:
    """A warning where packages that draw are not there."""
    lacking = absent(*DRAWING)
    return [f"no figures: {', '.join(lacking)} not installed; {command(lacking[0])}, then orchestrator report"] if lacking else []


def drawn(draw: Callable[..., object], *job: object) -> object:
    """Result of ``draw(*job)``, called in a process of its own; errors as from ``Artist.finish``."""
    with Artist() as artist:
        artist.begin(draw, *job)
        return artist.finish()


def main(connection: Connection) -> None:
    """Get ready, do the jobs; the end of who asks ends it."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    from orchestrator.results.figures.figures import warm_up

    warm_up()
    with suppress(EOFError, OSError):
        while True:
            draw, job = pickle.loads(connection.recv_bytes())
            try:
                answer = draw(*job)
            except InputError as error:
                answer = error
            connection.send(answer)


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
