"""One place where a code works: its process, its log, and how failures are told. Codes and
transports derive from it.
"""

from __future__ import annotations

import os
import resource
import select
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.blackbox.transport.messages import BadReply
from orchestrator.blackbox.usage import STAGES
from orchestrator.errors import BlackBoxError, wrong
from orchestrator.processes import end, last_words, memory_peak_mb, started

MB_PER_KIB = 1024 / 1e6  # the kernel counts in KiB, the summary in MB


class Ended(Exception):
    """The conversation broke off: end of stream, broken pipe or silence. ``what`` in one
    sentence.
    """


class Silence(Ended):
    """The process lives but does not answer."""

    def __init__(self) -> None:
        limited = resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
        super().__init__("no answer within the time allowed (blackbox.timeout)" + limited * (
            ", perhaps for want of memory: ulimit -v is set, and OpenBLAS waits for ever for what "
            "it forbids"))


class Worker:
    """Holds models of a code and answers for them; all methods but ``kill`` belong to one thread.

    code : the ``Code`` to run, with its settings
    folder : for meshes and messages; number : for file names
    keeps_models : whether answers come from factors that are kept
    promised : bits of ``messages.check_hello``, what the process says of itself
    calls, working : tasks, and seconds spent on them; seconds : of the code's own clock, per stage
    """

    keeps_models = True

    def __init__(self, code, folder: Path, number: int):
        self.code, self.folder, self.number = code, folder, number
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.calls, self.working = 0, 0.0
        self.peak_mb, self.promised = 0.0, 0
        self.process: subprocess.Popen | None = None
        # reentrant: a signal may interrupt its holder
        self._lock, self._killed = threading.RLock(), False
        # without a name: nothing is left behind whatever happens
        self.log = tempfile.TemporaryFile(dir=folder)

    # ---- what a code or a transport provides; names tell the subdomain when something fails ----

    def open(self) -> None:
        """Start what can be started before there is work."""

    def load(self, index: int, model: Model) -> None:
        """Assemble, clamp and factorise a model."""
        raise NotImplementedError

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]],
              names: list[str]) -> dict[int, np.ndarray]:
        """Displacements under (model, (rhs, m) forces) of all jobs; ``op`` is ``messages.TRACES``
        or ``FIELDS``.
        """
        raise NotImplementedError

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        """Stiffness of a model that is not kept, nothing clamped."""
        raise NotImplementedError

    def own_loads(self, index: int, model: Model, steps: int) -> np.ndarray:
        """(steps, 3n) nodal forces of the loads that a model brings."""
        raise NotImplementedError

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        """See ``protocol.BlackBox.advance``."""
        raise NotImplementedError

    def compliances(self) -> list[dict[str, object]]:
        """Subdomains whose interface compliance took the place of runs; none where processes stay
        alive.
        """
        return []

    def traits(self) -> Traits:
        """Traits; of those that the code leaves open the process has told when it started."""
        invariant, own = self.code.translation_invariant, self.code.own_matter
        nonlinear = bool(self.promised & 4)  # what remembers load steps answers for itself alone
        return Traits((bool(self.promised & 1) if invariant is None else invariant)
                      and not nonlinear,
                      bool(self.promised & 2) if own is None else own, self.keeps_models,
                      self.code.floor(), nonlinear)

    # ---- processes ------------------------------------------------------------------------------

    def spawn(self, requests: str, replies: str = "",
              pass_fds: tuple[int, ...] = ()) -> subprocess.Popen:
        """Start a process, which ends with the calling thread at the latest: that lives as long as
        the pool.
        """
        with self._lock:
            if self._killed:
                raise Ended("the black box was closed")
            self.process = started(self.code.command(requests, replies), cwd=self.folder,
                                   pass_fds=pass_fds,
                                   env=self.code.environment(), stdout=self.log, stderr=self.log)
        return self.process

    def wait_for_end(self, process: subprocess.Popen) -> tuple[int, float]:
        """Exit code and CPU seconds of a process that runs once; raises Silence when it takes too
        long.
        """
        handle = os.pidfd_open(process.pid)
        try:
            ready(handle, select.POLLIN, self.deadline())
            # the process is a zombie now: its memory is in what waiting for it returns
            with self._lock:
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
            self.peak_mb = max(self.peak_mb, usage.ru_maxrss * MB_PER_KIB)
            return process.returncode, usage.ru_utime + usage.ru_stime
        finally:
            os.close(handle)

    def kill(self) -> None:
        """End the process for good; from any thread, more than once."""
        with self._lock:
            self._killed = True
            if self.process is not None and self.process.returncode is None:
                self.note_memory()
                end(self.process)

    def release(self) -> None:
        """Reap the process and close what is open; after ``kill``, when the thread is done."""
        if self.process is not None:
            self.process.wait()
        self.log.close()

    def note_memory(self) -> float:
        """Largest resident memory of the process so far, MB."""
        if self.process is not None:
            # nan, of one that is gone, is no larger
            self.peak_mb = max(self.peak_mb, memory_peak_mb(self.process.pid))
        return self.peak_mb

    def deadline(self) -> float:
        """Time by which the answer to the present request must be there."""
        return time.monotonic() + self.code.settings.timeout

    def count(self, seconds) -> None:
        """Add a reply's own seconds (assemble, factorise, solve) to the clock."""
        for stage, value in zip(STAGES[1:], seconds):
            self.seconds[stage] += float(value)

    # ---- files and failures ---------------------------------------------------------------------

    def write(self, name: str, parts: list) -> Path:
        """Write a file into the work folder; raises InputError when the disk is full."""
        path = self.folder / name
        try:
            with open(path, "wb") as file:
                file.writelines(parts)
        except OSError as error:
            path.unlink(missing_ok=True)
            needed = sum(memoryview(part).nbytes for part in parts)
            raise wrong((),
                        f"writing {name} of {needed / 1e6:.1f} MB in {self.folder} failed: "
                        f"{error.strerror}",
                        "a temporary folder with room enough",
                        "free some room, or set TMPDIR to a folder on another disk") from error
        return path

    @contextmanager
    def telling(self, purpose: str, subdomain: str) -> Iterator[None]:
        """Have what ends the conversation told as BlackBoxError; ``purpose`` says what failed."""
        try:
            yield
        except (Ended, BadReply) as error:
            raise self.failure(purpose, error, subdomain) from error

    def failure(self, purpose: str, error: Exception, subdomain: str) -> BlackBoxError:
        """The error to raise, with the exit code of a process that ended and the log's tail."""
        meaning = ""
        if self.process is not None:
            # a stream that ends is a process about to end: its exit code comes a moment later
            ended = isinstance(error, Ended) and not isinstance(error, Silence)
            with suppress(subprocess.TimeoutExpired):
                meaning = self.code.meaning(self.process.wait(timeout=1.0 if ended else 0.0))
        return BlackBoxError(f"{self.code.name}: {purpose}: {error}", subdomain, meaning,
                             last_words(self.log))


def ready(fd: int, event: int, deadline: float) -> None:
    """Wait until a descriptor can be read from or written to; raises Silence at the deadline."""
    poll = select.poll()
    poll.register(fd, event)
    if not poll.poll(max(0.0, deadline - time.monotonic()) * 1000):
        raise Silence()
