"""checkpoint/: what a run needs to go on where it stood, a file for each iteration.

- ``iterations-000001.log`` …  what each iteration has added; the oldest go as soon as the method needs them no more
- ``batch-000.log`` …          the end of each batch of load steps: the fields themselves
- ``problem.json``             what the run's problem depends on, so that another one is told by what differs
- ``mesh.log``                 a mesh that was dear to make, see ``kept_mesh``

A thread of its own writes, so that the loop does not wait for the disk. Files are whole or not there; for the day the machine goes
down, the disk itself is waited for every ``SYNCED`` seconds and at the end of each batch.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.method.memory import MONITOR, Memory
from orchestrator.method.start import Start
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.record_file import write_record

NAME, ENDED, ITERATIONS = "checkpoint", "batch-*.log", "iterations-*.log"
PROBLEM = "problem.json"
RESERVE, MARGIN = "reserve", 1 << 16  # bytes for what is no array
_OWN = rf"{NAME}/((iterations-\d{{6,}}|batch-\d{{3,}}|mesh)\.log|{RESERVE}|problem\.json)"  # whatever a disk makes of them
SYNCED = 30.0  # seconds between two waits for the disk itself
WAITING = 4  # iterations that the loop may be ahead of the disk


def begun(folder: ResultsFolder) -> None:
    """Note that a run has begun here: if it is killed before its first iteration, it resumes at its beginning."""
    with folder.guarded(NAME):
        (folder / NAME).mkdir(exist_ok=True)
        folder.manifest.claim(_OWN)


def saved(folder: ResultsFolder) -> bool:
    """Whether iterations are there to resume from."""
    return any(next((folder / NAME).glob(pattern), None) for pattern in (ENDED, ITERATIONS))


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
        self._stale: list[Path] = []  # what begins anew
        if start is not None:
            self._stale = [path for path in self._path.glob(ITERATIONS) if _number(path) > start.iteration]
            self._stale += sorted(self._path.glob(ENDED))[len(start.ended):] if start.state is not None else []
        self._given_up = self._removed = self._reserved = False
        self._synced = time.monotonic()
        self._writer, self._pending = ThreadPoolExecutor(1, "checkpoint"), list[Future]()

    # ---- what the run tells --------------------------------------------------------------------

    def iteration(self, event: Iteration) -> None:
        if event.memory is None or self._removed:
            return
        if not self._reserved:
            with self._folder.guarded("what the end of the run will need"):
                self._reserve(event.memory)
        self._pending.append(self._writer.submit(self._keep_or_give_up, event.memory))
        self._wait(WAITING)

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
        """Wait until all iterations are written."""
        self._wait(0)

    def close(self) -> None:
        """Write what is pending, end the thread."""
        self.write()
        self._writer.shutdown()

    def remove(self) -> None:
        """All results are there: the checkpoint goes."""
        self._removed = True
        self.close()
        self._folder.remove(f"{NAME}/*")
        with suppress(OSError):
            self._path.rmdir()

    # ---- writing -------------------------------------------------------------------------------

    def _wait(self, left: int) -> None:
        """Until at most so many iterations are not written."""
        while len(self._pending) > left:
            self._pending[0].result()
            self._pending.pop(0)  # now, so that an interrupt does not lose it

    def _keep_or_give_up(self, memory: Memory) -> None:
        if self._removed or self._given_up and not memory.ended:
            return
        try:
            self._keep(memory)
        except (OSError, MemoryError) as first:
            self._free(memory)
            try:
                self._keep(memory)
            except (OSError, MemoryError):
                self._give_up(first)

    def _keep(self, memory: Memory) -> None:
        _remove(self._stale)
        self._stale = []
        if memory.ended:
            if memory.notes["last"]:
                (self._path / RESERVE).unlink(missing_ok=True)
            # first, so that no run goes on after an iteration that was the last
            self._write(f"batch-{memory.batch:03}.log", memory, _needed_after, sync=True)
        if memory.ended and memory.notes["met"]:
            self._forget()  # the results may need the room
        elif not self._given_up:
            sync = time.monotonic() - self._synced > SYNCED
            self._write(f"iterations-{memory.iteration:06}.log", memory, lambda name: "/delivered" not in name, sync)
            self._synced = time.monotonic() if sync else self._synced
            first = memory.iteration - memory.back + 1  # that the method needs
            _remove(path for path in self._path.glob(ITERATIONS) if _number(path) < first)

    def _write(self, name: str, memory: Memory, chosen: Callable[[str], bool], sync: bool) -> None:
        header = {"iteration": memory.iteration, "batch": memory.batch, "back": memory.back, "notes": memory.notes}
        arrays = {name: array for name, array in memory.arrays.items() if chosen(name)}
        write_record(self._path / name, self._fingerprint, header, arrays, sync)

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

    def _free(self, memory: Memory) -> None:
        """Make room on a full disk: the end of a batch needs none of the iterations before."""
        if memory.ended:
            self._forget()
            with suppress(OSError):
                (self._path / RESERVE).unlink(missing_ok=True)
            self._given_up = True

    def _forget(self) -> None:
        with suppress(OSError):
            _remove(self._path.glob(ITERATIONS))

    def _give_up(self, error: Exception) -> None:
        if not self._given_up:
            self._warn(f"No checkpoint can be written in {self._path} ({getattr(error, 'strerror', None) or error}): the run goes on "
                       "without; if it is killed, --resume begins where the last checkpoint was.")
        self._given_up = True


def _needed_after(name: str) -> bool:
    """Whether an array is needed once its batch has ended."""
    return "/delivered" in name or f"/{MONITOR}" in name or name.startswith(("common/", "interface"))


def _number(path: Path) -> int:
    return int("0" + "".join(filter(str.isdigit, path.stem)))


def _remove(paths: Iterable[Path]) -> None:
    for path in list(paths):
        path.unlink(missing_ok=True)
