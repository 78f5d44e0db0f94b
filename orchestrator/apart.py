"""A process that calls functions for this one, made ready beforehand: libraries may end their
process, and so may the kernel.
"""

from __future__ import annotations

import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, Pipe
from queue import SimpleQueue
from threading import Thread

from orchestrator.errors import wrong
from orchestrator.processes import end, started


class Died(Exception):
    """The process has ended without an answer, ``code`` as ``subprocess`` has it, None where it
    never began, or is given up.
    """

    def __init__(self, code: int | None, late: bool = False):
        super().__init__(code, late)
        self.code, self.late = code, late


class Apart:
    """The process; as a context manager it is ended on leaving. It ends with this one.

    ready : modules that it imports at once, and of which it calls ``warm_up`` where they have one
    """

    def __init__(self, ready: Sequence[str]) -> None:
        self._connection, theirs = Pipe()
        self._jobs: SimpleQueue[bytes | None] = SimpleQueue()
        self._process, self._asked = None, 0
        with suppress(OSError):  # no more processes are allowed: nobody ever answers
            self._process = started([sys.executable, "-P", "-m", __name__, str(theirs.fileno()),
                                     *ready], pass_fds=[theirs.fileno()],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        theirs.close()
        Thread(target=self._send, daemon=True).start()  # pipes hold less than a job

    def begin(self, call: Callable[..., object], *job: object) -> None:
        """Have ``call(*job)`` called there, after what was asked before; the function is one of a
        module, and all is pickled now.
        """
        self._jobs.put(pickle.dumps((call, job), pickle.HIGHEST_PROTOCOL))
        self._asked += 1

    def _send(self) -> None:
        with suppress(OSError):  # it has ended before
            for job in iter(self._jobs.get, None):
                self._connection.send_bytes(job)

    def finish(self, patience: float | None = None) -> object:
        """The result of the last function that was asked for; raises what the first one that failed
        has raised.

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
        self._jobs.put(None)
        if self._process is not None:
            end(self._process)
            self._process.wait()

    def __enter__(self) -> Apart:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Mesher(Apart):
    """A process that makes the finer meshes of CAD models: where gmsh ends it, or the kernel for
    want of memory, results are still there.

    It is ready, with gmsh, by the time that the first mesh is solved on.
    """

    def __init__(self) -> None:
        super().__init__(["orchestrator.scene.mesh.solids", "gmsh"])

    def __call__(self, make: Callable[..., object], *given: object) -> object:
        """Return what ``make(*given)`` returns, called there; raises what that raises, and
        InputError
        where the process ends.
        """
        self.begin(make, *given)
        try:
            return self.finish()
        except Died as died:
            how = (
                "did not begin"
                if died.code is None
                else (
                    f"was ended by {signal.Signals(-died.code).name}"
                    if died.code < 0
                    else f"has ended with {died.code}"
                )
            )
            raise wrong(("mesh",), f"the process that makes meshes {how}",
                        "a mesh: gmsh fails on few models, the kernel ends what takes more "
                        "memory than there is",
                        "set the limits elements or memory of method.accuracy, or mesh that part "
                        "by hand") from None


def main(connection: Connection, ready: Sequence[str]) -> None:
    """Get ready, do the jobs; the end of who asks ends it."""
    # where VTK can draw nowhere it crashes: no core dump
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
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
