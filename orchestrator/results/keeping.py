"""Writes every iteration to checkpoint/ (``checkpoint`` says what is in it).

For the day the machine goes down, the disk itself is waited for every ``SYNCED`` seconds and at the
end of each increment.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from orchestrator.method.checkpoint import Checkpoint, Start, kind_of
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.results.checkpoint import FILES, NAME, RESERVE, TOLD, Warn, begun
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.manifest import UNFINISHED

SYNCED = 30.0  # seconds between two waits for the disk itself
MARGIN = 1 << 16  # bytes for what is no array


class CheckpointWriter(Subscriber):
    """Writes every iteration to the results folder; ``remove`` it when all results are there.

    The room that the end of the run needs is taken at its first iteration: a run whose end would
    not fit is not worth computing. A disk that is full later ends no run: what is not needed any
    more is removed, and if that is too little the run goes on without, and says so. What is needed
    no more goes once what comes after it is written.

    folder : where
    fingerprint : of the problem
    start : where the run goes on from what an earlier one has left here; None at the beginning
    warn : what is told to the user
    Raises InputError: from the first iteration, if there is no room for the end of the run
    """

    wants_checkpoints = True

    def __init__(self, folder: ResultsFolder, fingerprint: str, start: Start | None = None,
                 warn: Warn = lambda text: print(text, file=sys.stderr)):
        self._folder, self._fingerprint, self._warn = folder, fingerprint, warn
        self._path = folder.path.absolute() / NAME
        # file → iteration after which it is needed no more; what nobody goes on from goes first
        self._spare: dict[Path, float] = {}
        self._ended: dict[int, Path] = {}
        if start is not None:
            self._spare = dict.fromkeys(self._path.glob(FILES), -math.inf)
            self._spare |= {self._path / x.file.name: x.iteration for x in start.latest}
            for x in start.ended:
                self._spare.pop(self._path / x.file.name, None)
                self._ended[x.increment] = self._path / x.file.name
        self._reserved, self.keeps, self._synced = False, True, time.monotonic()
        self._reserve_file = self._path / RESERVE

    def iteration(self, event: Iteration) -> None:
        checkpoint = event.checkpoint
        if checkpoint is None or not (self.keeps or checkpoint.ended):
            return
        if not self._reserved:
            self._reserve(checkpoint)
        error = self._tried(self._write, checkpoint)
        if error is None:
            if not checkpoint.goes_on:
                self._drop(math.inf)  # the results may need the room
            elif self.keeps:
                self._drop(checkpoint.iteration - max(checkpoint.evaluations, 1) + 1)
            return
        if checkpoint.ended:  # it needs none of those before
            self._drop(math.inf)
            self._reserve_file.unlink(missing_ok=True)
        if not checkpoint.ended or self._tried(self._write, checkpoint):
            self._go_on_without(error)
        self.keeps = False

    @property
    def ended(self) -> list[Path]:
        """The last file of each increment, in order."""
        return [self._ended[number] for number in sorted(self._ended)]

    def remove(self) -> None:
        """Remove the checkpoint: all results are there."""
        self._folder.remove(f"{NAME}/*")
        with suppress(OSError):
            self._path.rmdir()

    def _go_on_without(self, error: OSError) -> None:
        if self.keeps:
            self._warn(f"No checkpoint can be written in {self._path} ({error.strerror}): the run "
                       "goes on without; if it is killed, --resume begins where the last "
                       "checkpoint was.")

    def _tried(self, action: Callable[..., None], given: object) -> OSError | None:
        """Return what has kept from doing it; None: it is done."""
        try:
            action(given)
        except (OSError, MemoryError) as error:
            text = getattr(error, "strerror", None) or str(error) or type(error).__name__
            return OSError(getattr(error, "errno", None), text)
        return None

    def _drop(self, first: float) -> None:
        """Remove files before iteration ``first``."""
        for path in [path for path, iteration in self._spare.items() if iteration < first]:
            del self._spare[path]
            path.unlink(missing_ok=True)

    def _reserve(self, checkpoint: Checkpoint) -> None:
        """Take the room that the end of the run will need: what is known now, and seven fields."""
        self._reserved = True
        begun(self._folder)
        width = max(array.shape[1] for name, array in checkpoint.arrays.items()
                    if kind_of(name) == "trace")
        size = sum(array.nbytes for array in checkpoint.arrays.values())
        error = self._tried(self._take, size + 8 * 7 * checkpoint.notes["steps"] * width + MARGIN)
        if error is not None:
            with self._folder.guarded(f"what the end of the run will need ({error.strerror})"):
                raise error

    def _take(self, size: int) -> None:
        self._reserve_file.unlink(missing_ok=True)
        try:
            with open(self._reserve_file, "wb") as file:
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError:
            self._reserve_file.unlink(missing_ok=True)
            raise

    def _write(self, checkpoint: Checkpoint) -> None:
        """Write a file; wait for the disk at the end of an increment, and at times."""
        if checkpoint.ended and checkpoint.notes["last"]:
            self._reserve_file.unlink(missing_ok=True)
        about = {name: getattr(checkpoint, name) for name in TOLD}
        about |= {"problem": self._fingerprint, "arrays": sorted(checkpoint.arrays)}
        text = json.dumps(about, default=lambda number: number.item()).encode()
        path = self._path / f"iteration-{checkpoint.iteration:06}.npz"
        temporary = path.with_name(f".{path.name}{UNFINISHED}")
        self._path.mkdir(exist_ok=True)
        temporary.unlink(missing_ok=True)  # nothing is written through a link
        try:
            with open(temporary, "wb") as file:
                np.savez(file, about=np.frombuffer(text, np.uint8), **checkpoint.arrays)
                file.flush()
                if checkpoint.ended or time.monotonic() - self._synced > SYNCED:
                    os.fsync(file.fileno())
                    self._synced = time.monotonic()
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
        self._spare.pop(path, None)
        if not checkpoint.ended:
            self._spare[path] = checkpoint.iteration
        else:
            self._ended[checkpoint.increment] = path
