"""A process that draws, made ready while the run computes: a graphics library that finds no display may end its process."""

from __future__ import annotations

import os
import pickle
import resource
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread

from orchestrator.errors import InputError

PATIENCE = 300.0  # seconds after which the process is given up


class CannotDraw(Exception):
    """The process has ended without an answer, or has been given up."""


class Artist:
    """The process; as a context manager it is ended on leaving."""

    def __init__(self) -> None:
        fresh = get_context("spawn")  # a fork of a process that has threads may never wake up
        self._connection, theirs = fresh.Pipe()
        self._process = fresh.Process(target=_serve, args=(theirs,), daemon=True)
        with suppress(OSError):  # no more processes are allowed: it never answers
            self._process.start()
        theirs.close()

    def begin(self, draw: Callable[..., object], *job: object) -> None:
        """Have ``draw(*job)`` called there, once; the function is one of a module, and all is pickled now."""
        Thread(target=self._send, args=(pickle.dumps((draw, job), pickle.HIGHEST_PROTOCOL),), daemon=True).start()  # pipes hold less

    def _send(self, job: bytes) -> None:
        with suppress(OSError):  # it has ended before
            self._connection.send_bytes(job)

    def finish(self) -> object:
        """What the function returned.

        Raises CannotDraw: the process crashes, as where VTK finds neither a display, EGL nor OSMesa, or takes longer than ``PATIENCE``
        Raises InputError: from the function: disk full or folder not writable
        """
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
        if self._process.pid is not None:
            self._process.kill()
            self._process.join()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def drawn(draw: Callable[..., object], *job: object) -> object:
    """What ``draw(*job)`` returns, called in a process of its own; errors as from ``Artist.finish``."""
    with Artist() as artist:
        artist.begin(draw, *job)
        return artist.finish()


def _serve(connection: Connection) -> None:
    """Get ready, do the job, end; the end of who asks ends it too."""
    os.setpgid(0, 0)  # Ctrl-C is for the run, which then ends this process
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    from orchestrator.results.figures.figures import warm_up

    warm_up()
    with suppress(EOFError, OSError):
        draw, job = pickle.loads(connection.recv_bytes())
        try:
            answer = draw(*job)
        except InputError as error:
            answer = error
        connection.send(answer)
