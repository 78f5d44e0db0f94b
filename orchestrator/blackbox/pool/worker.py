"""What the workers of all transports share: their processes, their log, and how failures are told."""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.pool.starvation import Starvation
from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.blackbox.usage import STAGES
from orchestrator.errors import BlackBoxError, InputError, Problem
from orchestrator.parallel.launcher import without_launcher

if TYPE_CHECKING:
    from orchestrator.blackbox.codes.code import Code

LOG_TAIL = 2000  # bytes
MB_PER_KIB = 1024 / 1e6  # the kernel counts in KiB, the summary in MB


class Ended(Exception):
    """The conversation broke off: end of stream, broken pipe or silence. ``what`` in one sentence."""


class Silence(Ended):
    """The process lives but does not answer."""

    def __init__(self) -> None:
        super().__init__("no answer within the time allowed (blackbox.timeout)")


class Worker:
    """One place where a process of the code runs; all methods but ``kill`` belong to one thread.

    Parameters
    ----------
    code : what to run, and its settings
    folder : where meshes and messages are written
    number : for file names
    """

    def __init__(self, code: Code, folder: Path, number: int):
        self.code, self.folder, self.number = code, folder, number
        self.timeout = code.settings.timeout
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.calls, self.working = 0, 0.0  # tasks, and seconds spent on them
        self.peak_mb = 0.0
        self.process: subprocess.Popen | None = None
        self._lock = threading.RLock()  # reentrant: a signal may interrupt its holder
        self._killed = False
        self.promised = 0  # bits of ``messages.hello``: what the process says of itself
        # without a name: nothing is left behind whatever happens
        self.log = tempfile.TemporaryFile(dir=folder)

    keeps_models: ClassVar[bool] = True

    # What a transport provides; ``names`` tell the subdomain when something fails.
    def open(self) -> None:
        """Start what can be started before there is work."""

    def load(self, index: int, model: Model) -> None:
        raise NotImplementedError

    def load_all(self, models: Mapping[int, Model]) -> None:
        """Load models, by their numbers."""
        for index, model in models.items():
            self.load(index, model)

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]], names: list[str]) -> dict[int, np.ndarray]:
        raise NotImplementedError

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        raise NotImplementedError

    def all_stiffness(self, models: Mapping[int, Model]) -> dict[int, sp.csr_array]:
        """Stiffness matrices of models, by their numbers."""
        return {index: self.stiffness(index, model) for index, model in models.items()}

    def own_loads(self, index: int, model: Model, steps: int) -> np.ndarray:
        raise NotImplementedError

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        raise NotImplementedError

    def compliances(self) -> list[dict[str, object]]:
        """Subdomains whose interface compliance took the place of runs; none where processes stay alive."""
        return []

    def traits(self) -> Traits:
        """What may be relied on; of what the code leaves open the process has told when it started."""
        invariant, own = self.code.translation_invariant, self.code.own_matter
        nonlinear = bool(self.promised & 4)  # what remembers load steps answers for itself alone
        return Traits((bool(self.promised & 1) if invariant is None else invariant) and not nonlinear,
                      bool(self.promised & 2) if own is None else own, self.keeps_models,
                      self.code.floor(), nonlinear)

    def spawn(self, requests: str, replies: str, pass_fds: tuple[int, ...] = ()) -> subprocess.Popen:
        """Start a process. The kernel kills it with the calling thread, which must live as long as the pool."""
        command = self.code.command(requests, replies)
        setpriv = shutil.which("setpriv")
        if setpriv:
            command = [setpriv, "--pdeathsig", "KILL", *command]
        with self._lock:
            if self._killed:
                raise Ended("the black box was closed")
            self.process = subprocess.Popen(
                command, cwd=self.folder, env=without_launcher(self.code.environment()), pass_fds=pass_fds,
                stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log,
                process_group=0,  # Ctrl-C is for the orchestrator, which then ends its processes itself
            )
        return self.process

    def wait_for_end(self, process: subprocess.Popen) -> tuple[int, float]:
        """Exit code and CPU seconds of a process that runs once; raises Silence when it takes too long."""
        handle = os.pidfd_open(process.pid)
        try:
            poll = select.poll()
            poll.register(handle, select.POLLIN)
            end, hopeless = self.deadline(), Starvation(process.pid)
            while not poll.poll(max(0.0, min(end - time.monotonic(), 1.0)) * 1000):
                if why := hopeless():
                    raise Ended(why)
                if time.monotonic() >= end:
                    raise Silence()
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
                # the whole group: the executable may be a script around the real one
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self.process.pid, signal.SIGKILL)

    def release(self) -> None:
        """Reap the process and close what is open; after ``kill``, when the thread is done."""
        if self.process is not None:
            self.process.wait()
        self.log.close()

    def note_memory(self) -> float:
        """Largest resident memory of the process so far, MB."""
        try:
            with open(f"/proc/{self.process.pid}/status") as status:
                for row in status:
                    if row.startswith("VmHWM"):
                        self.peak_mb = max(self.peak_mb, int(row.split()[1]) * MB_PER_KIB)
        except (OSError, AttributeError):
            pass  # not running
        return self.peak_mb

    def write(self, name: str, parts: list) -> Path:
        """Write a file into the work folder; raises InputError when the disk is full."""
        path = self.folder / name
        try:
            with open(path, "wb", buffering=0) as file:
                for part in parts:
                    view = memoryview(part).cast("B")
                    while len(view):
                        view = view[file.write(view) :]
        except OSError as error:
            path.unlink(missing_ok=True)
            needed = sum(memoryview(part).nbytes for part in parts)
            raise InputError(Problem(
                (), f"writing {name} of {needed / 1e6:.1f} MB in {self.folder} failed: {error.strerror}",
                "a temporary folder with room enough", "free some room, or set TMPDIR to a folder on another disk",
            )) from error
        return path

    def write_mesh(self, index: int, model: Model) -> Path:
        """Mesh file of a model."""
        return self.write(f"mesh-{index}.{self.code.mesh_suffix}", [self.code.mesh(model)])

    def failure(self, purpose: str, error: Exception, subdomain: str) -> BlackBoxError:
        """The error to raise, with the exit code of a process that ended and the log's tail."""
        meaning = ""
        if self.process is not None:
            # a stream that ends is a process about to end: its exit code comes a moment later
            ended = isinstance(error, Ended) and not isinstance(error, Silence)
            try:
                meaning = self.code.meaning(self.process.wait(timeout=1.0 if ended else 0.0))
            except subprocess.TimeoutExpired:
                pass
        return BlackBoxError(f"{self.code.name}: {purpose}: {error}", subdomain, meaning, self.log_tail())

    def log_tail(self) -> str:
        """Last lines of what the process printed."""
        size = os.fstat(self.log.fileno()).st_size
        # pread: the offset is shared with the process that writes
        tail = os.pread(self.log.fileno(), LOG_TAIL, max(0, size - LOG_TAIL))
        return tail.decode(errors="replace").strip()

    def count(self, seconds: np.ndarray) -> None:
        """Add a reply's own seconds to the clock."""
        for stage, value in zip(("assemble", "factorise", "solve"), seconds):
            self.seconds[stage] += float(value)

    def deadline(self) -> float:
        """When the answer to what is asked now must be there."""
        return time.monotonic() + self.timeout
