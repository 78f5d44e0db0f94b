"""A process that calls functions for this one, made ready beforehand: libraries may end their process, and so may the kernel."""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, Pipe
from threading import Thread

from orchestrator.processes import without_launcher


class Died(Exception):
    """The process has ended without an answer, ``code`` as ``subprocess`` has it, None where it never began, or is given up."""

    def __init__(self, code: int | None, late: bool = False):
        super().__init__(code, late)
        self.code, self.late = code, late


class Apart:
    """The process; as a context manager it is ended on leaving. It ends with this one.

    ready : modules that it imports at once, and of which it calls ``warm_up`` where they have one
    """

    def __init__(self, ready: Sequence[str]) -> None:
        self._connection, theirs = Pipe()
        self._process = self._sender = None
        self._asked = 0
        with suppress(OSError):  # no more processes are allowed: nobody ever answers
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(theirs.fileno()), *ready], pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=without_launcher(os.environ),
                process_group=0)  # Ctrl-C is for the run, which then ends it
        theirs.close()

    def begin(self, call: Callable[..., object], *job: object) -> None:
        """Have ``call(*job)`` called there, after what was asked before; the function is one of a module, and all is pickled now."""
        job = pickle.dumps((call, job), pickle.HIGHEST_PROTOCOL), self._sender
        self._sender, self._asked = Thread(target=self._send, args=job, daemon=True), self._asked + 1
        self._sender.start()  # pipes hold less than a job

    def _send(self, job: bytes, before: Thread | None) -> None:
        if before is not None:
            before.join()
        with suppress(OSError):  # it has ended before
            self._connection.send_bytes(job)

    def finish(self, patience: float | None = None) -> object:
        """The result of the last function that was asked for; raises what the first one that failed has raised.

        patience : seconds for each answer; None: no limit
        Raises Died: the process has ended, or takes longer
        """
        answer, asked, self._asked = None, self._asked, 0
        for _ in range(asked):
            if not self._connection.poll(patience):
                self.close()
                raise Died(None, late=True)
            try:
                answer = self._connection.recv()
            except (EOFError, OSError):
                raise Died(self._process and self._process.wait()) from None
            if isinstance(answer, Exception):
                raise answer
        return answer

    def close(self) -> None:
        """End the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Apart:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def main(connection: Connection, ready: Sequence[str]) -> None:
    """Get ready, do the jobs; the end of who asks ends it."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # where VTK can draw nowhere it crashes: no core dump
    for module in ready:
        getattr(import_module(module), "warm_up", lambda: None)()
    with suppress(EOFError, OSError):
        while True:
            call, job = pickle.loads(connection.recv_bytes())
            try:
                answer = call(*job)
            except Exception as error:  # noqa: BLE001 - who asks gets it
                answer = error
            connection.send(answer)


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])), sys.argv[2:])
