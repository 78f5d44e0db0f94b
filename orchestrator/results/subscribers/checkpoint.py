"""checkpoint/: what a run needs to go on exactly where it stood, appended iteration by iteration.

- ``iterations-000001.log`` …  what each iteration has added; the oldest go as soon as the method needs them no more
- ``batch-000.log`` …          the end of each batch of load steps: the fields themselves
- ``problem.json``             what the run's problem depends on, so that another one is told by what differs
- ``mesh.log``                 a mesh that was dear to make, see ``kept_mesh``

A thread of its own writes at most ``DELAY`` seconds after an iteration, so that a killed process loses that much or
the iteration under way, and the loop does not wait for the disk. Killed processes leave whole records; for the day the
machine goes down, the disk itself is waited for every ``SYNCED`` seconds and at the end.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.method.memory import INTERVAL, MONITOR, Memory
from orchestrator.method.start import Start
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.subscribers.log import append

NAME, ENDED, SEGMENTS = "checkpoint", "batch-*.log", "iterations-*.log"
PROBLEM = "problem.json"
RESERVE, MARGIN = "reserve", 1 << 16  # bytes for what is no array
_OWN = rf"{NAME}/((iterations-\d{{6,}}|batch-\d{{3,}}|mesh)\.log|{RESERVE}|problem\.json)"  # whatever a disk makes of them
DELAY = 0.5  # seconds that an iteration waits for others, to be written together
SYNCED = 30.0  # seconds between two waits for the disk itself


def begun(folder: ResultsFolder) -> None:
    """Note that a run has begun here: if it is killed before its first iteration, it resumes at its beginning."""
    with folder.guarded(NAME):
        (folder / NAME).mkdir(exist_ok=True)
        folder.manifest.claim(_OWN)


def saved(folder: ResultsFolder) -> bool:
    """Whether iterations are there to resume from."""
    return any(next((folder / NAME).glob(pattern), None) for pattern in (ENDED, SEGMENTS))


class Checkpoint(Subscriber):
    """Writes every iteration to the results folder; ``remove`` it when all results are there.

    The room that the end of the run needs is taken at its first iteration: a run whose end would not fit is not worth
    computing. A disk that is full later ends no run: what is not needed any more is removed, and if that is too little
    the run goes on without, and says so.

    Parameters
    ----------
    folder : where
    fingerprint : of the problem
    start : where the run goes on from what an earlier one has left here; None at the beginning
    warn : what is told to the user

    Raises
    ------
    InputError : from the first iteration, if there is no room for the end of the run
    """

    wants_memory = True

    def __init__(self, folder: ResultsFolder, fingerprint: str, start: Start | None = None,
                 warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)):
        self._folder, self._fingerprint, self._warn = folder, fingerprint, warn
        self._path = folder / NAME
        self._segments: list[tuple[Path, int]] = []  # and the last iteration in each, at most
        self._stale: list[Path] = []  # ends of batches that begin anew
        if start is not None:
            self._segments = [(path, start.iteration) for path in sorted(self._path.glob(SEGMENTS))]
            self._stale = sorted(self._path.glob(ENDED))[len(start.ended):] if start.state is not None else []
        self._file = None
        self._in_file = 0
        self._pending: list[Memory] = []
        self._given_up = self._removed = self._reserved = False
        self._synced = time.monotonic()
        self._lock, self._wake, self._stop = threading.Lock(), threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    # ---- what the run tells --------------------------------------------------------------------

    def iteration(self, event: Iteration) -> None:
        if event.memory is None or self._removed:
            return
        if not self._reserved:
            with self._folder.guarded("what the end of the run will need"):
                self._reserve(event.memory)
        self._pending.append(event.memory)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="checkpoint", daemon=True)
            self._thread.start()
        self._wake.set()

    def finished(self, event: Finished) -> None:
        self.write()

    def failed(self, error: BaseException) -> None:
        self.write()

    # ---- what the owner asks -------------------------------------------------------------------

    @property
    def keeps(self) -> bool:
        """Whether iterations are written; the disk may have been full."""
        return not self._given_up

    def write(self) -> None:
        """Write what is pending now, and wait for the disk."""
        with self._lock:
            self._write_pending()
            self._sync()

    def close(self) -> None:
        """Write what is pending, end the thread."""
        self._stop.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()
        self.write()
        with self._lock:
            self._close_file()

    def remove(self) -> None:
        """All results are there: the checkpoint goes."""
        self._removed = True
        self.close()
        self._folder.remove(f"{NAME}/*")
        with suppress(OSError):
            self._path.rmdir()

    # ---- writing -------------------------------------------------------------------------------

    def _work(self) -> None:
        while not self._stop.is_set():
            self._wake.wait()
            self._wake.clear()
            self._stop.wait(DELAY)
            with self._lock:
                self._write_pending()
                if time.monotonic() - self._synced > SYNCED:
                    self._sync()

    def _write_pending(self) -> None:
        while self._pending and not self._removed:
            memory = self._pending[0]
            if not self._given_up or memory.ended:
                self._keep_or_give_up(memory)
            self._pending.pop(0)  # now, so that an interrupt does not lose it

    def _keep_or_give_up(self, memory: Memory) -> None:
        try:
            self._keep(memory)
        except (OSError, MemoryError) as first:
            self._free(memory)
            try:
                self._keep(memory)
            except (OSError, MemoryError):
                self._give_up(first)

    def _keep(self, memory: Memory) -> None:
        for path in self._stale:
            path.unlink(missing_ok=True)
        self._stale = []
        if memory.ended:
            if memory.notes["last"]:
                (self._path / RESERVE).unlink(missing_ok=True)
            self._end(memory)  # first, so that no run goes on after an iteration that was the last
        if memory.ended and memory.notes["met"]:
            self._forget()  # the results may need the room
        elif not self._given_up:
            self._append(memory)

    def _reserve(self, memory: Memory) -> None:
        """Take the room that the end of the run will need."""
        self._reserved = True
        begun(self._folder)
        rest = sum(array.nbytes for name, array in memory.arrays.items() if not name.startswith("trace"))
        width = max(array.shape[1] for name, array in memory.arrays.items() if name.startswith("trace"))
        try:
            (self._path / RESERVE).unlink(missing_ok=True)
            with open(self._path / RESERVE, "wb") as file:
                os.posix_fallocate(file.fileno(), 0, rest + 8 * 4 * memory.notes["steps"] * width + MARGIN)
        except OSError:
            (self._path / RESERVE).unlink(missing_ok=True)
            raise

    def _append(self, memory: Memory) -> None:
        if self._file is None or self._in_file >= INTERVAL:
            self._close_file()
            path = self._path / f"iterations-{memory.iteration:06}.log"
            self._file = self._new(path)
            self._segments = [(p, last) for p, last in self._segments if p != path] + [(path, 0)]
            self._in_file = 0
        arrays = {name: array for name, array in memory.arrays.items() if "/delivered" not in name}
        append(self._file, self._fingerprint, _header(memory), arrays)
        self._in_file += 1
        self._segments[-1] = self._segments[-1][0], memory.iteration
        self._drop(memory.iteration - memory.back + 1)

    def _end(self, memory: Memory) -> None:
        """The end of a batch in a file of its own; the iterations before it are needed no more once it is there."""
        arrays = {name: array for name, array in memory.arrays.items()
                  if "/delivered" in name or f"/{MONITOR}" in name or name.startswith(("common/", "interface"))}
        with self._new(self._path / f"batch-{memory.batch:03}.log") as file:
            append(file, self._fingerprint, _header(memory), arrays)
            os.fsync(file.fileno())

    def _new(self, path: Path):
        self._path.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # nothing is written through a link
        return open(path, "wb", buffering=0)

    def _drop(self, first: int) -> None:
        """Remove files all of whose iterations are before ``first``."""
        for path, last in self._segments[:-1]:
            if last < first:
                path.unlink(missing_ok=True)
        self._segments = [(path, last) for path, last in self._segments if path.exists()]

    def _free(self, memory: Memory) -> None:
        """Make room on a full disk: the end of a batch needs none of the iterations before."""
        if memory.ended:
            self._forget()
            with suppress(OSError):
                (self._path / RESERVE).unlink(missing_ok=True)
            self._given_up = True

    def _forget(self) -> None:
        """Remove the iterations so far."""
        self._close_file()
        for path, _ in self._segments:
            with suppress(OSError):
                path.unlink(missing_ok=True)
        self._segments = []

    def _give_up(self, error: Exception) -> None:
        if not self._given_up:
            self._warn(f"No checkpoint can be written in {self._path} ({getattr(error, 'strerror', None) or error}): the run goes on "
                       "without; if it is killed, --resume begins where the last checkpoint was.")
        self._given_up = True
        self._close_file()
        if self._segments and not self._in_file:
            with suppress(OSError):
                self._segments.pop()[0].unlink()

    def _sync(self) -> None:
        if self._file is not None:
            with suppress(OSError):
                os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def _close_file(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def _header(memory: Memory) -> dict[str, object]:
    return {"iteration": memory.iteration, "batch": memory.batch, "back": memory.back, "notes": memory.notes}
