"""Writes every iteration to checkpoint/, of which ``checkpoint`` says what is in it: each rank its own part.

Files are whole or not there; for the day the machine goes down, the disk itself is waited for every ``SYNCED`` seconds and at the end
of each increment. What is needed no more goes once all ranks have written what comes after it: one that is killed leaves an iteration
that all have.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import sys
import time
import uuid
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.method.checkpoint import Checkpoint, Numbers, Start, kind_of
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.parallel.team import ALONE, Team
from orchestrator.results.checkpoint import INCREMENTS, ITERATIONS, NAME, RESERVE, VERSION, begun, columns_of, number_of, rank_of
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.manifest import UNFINISHED

SYNCED = 30.0  # seconds between two waits for the disk itself
MARGIN = 1 << 16  # bytes for what is no array


@dataclass
class Failed:
    """Why a file could not be written; where: on which of several ranks."""

    cause: OSError
    where: str


class CheckpointWriter(Subscriber):
    """Writes every iteration to the results folder; ``remove`` it when all results are there.

    The room that the end of the run needs is taken at its first iteration: a run whose end would not fit is not worth
    computing. A disk that is full later ends no run: what is not needed any more is removed, and if that is too little
    the run goes on without, and says so. Of several ranks each has a copy of rank 0's, and writes its own columns; what one of them
    cannot write, none goes on to keep.

    folder : where
    fingerprint : of the problem
    start : where the run goes on from what an earlier one has left here; None at the beginning
    warn : what is told to the user
    Raises InputError: from the first iteration, if there is no room for the end of the run
    """

    wants_checkpoints = True

    def __init__(self, folder: ResultsFolder, fingerprint: str, start: Start | None = None,
                 warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)):
        self._folder, self._path, self._fingerprint, self._warn = folder, folder.path.absolute() / NAME, fingerprint, warn
        self._stale: list[Path] = []  # what begins anew, once it has
        if start is not None:
            self._stale = [path for path in self._path.glob(ITERATIONS) if number_of(path) > start.iteration]
            self._stale += [path for path in self._path.glob(INCREMENTS) if number_of(path) >= len(start.ended)]
        self._reserved, self.keeps, self._synced = False, True, time.monotonic()

    def begins(self, team: Team, numbers: Numbers) -> None:
        self._team, self._columns = team, columns_of(numbers)
        self._run = [team.share(uuid.uuid4().hex), team.rank, team.size]  # parts of two runs make no whole

    def __getstate__(self) -> dict[str, object]:
        """What the other ranks need: it is rank 0 that speaks, and that removes all in the end."""
        return vars(self) | {"_folder": None, "_warn": None, "_team": ALONE}

    def iteration(self, event: Iteration) -> None:
        checkpoint = event.checkpoint
        if checkpoint is None or not (self.keeps or checkpoint.ended):
            return
        if not self._reserved:
            self._reserve(checkpoint)
        if not (error := self._tried(lambda: self._write(checkpoint))):  # what nobody needs any more goes, now that all ranks have it
            first = checkpoint.iteration - max(checkpoint.evaluations, 1) + 1
            if checkpoint.ended and checkpoint.notes["met"]:
                self._unlink(self._path.glob(ITERATIONS))  # the results may need the room
            elif self.keeps:
                self._unlink(path for path in self._path.glob(ITERATIONS) if number_of(path) < first)
            return
        if checkpoint.ended:  # it needs none of those before
            self._unlink(self._path.glob(ITERATIONS))
            self._reserve_file.unlink(missing_ok=True)
        if not checkpoint.ended or self._tried(lambda: self._write(checkpoint, alone=True)):
            self._go_on_without(error)
        self.keeps = False

    def remove(self) -> None:
        """All results are there: the checkpoint goes."""
        self._folder.remove(f"{NAME}/*")
        with suppress(OSError):
            self._path.rmdir()

    def _go_on_without(self, error: Failed) -> None:
        if self.keeps and not self._team.rank:
            self._warn(f"No checkpoint can be written in {self._path} ({error.cause.strerror}{error.where}): the run "
                       "goes on without; if it is killed, --resume begins where the last checkpoint was.")
        self.keeps = False

    def _tried(self, action: Callable[[], None]) -> Failed | None:
        """What has kept one of the ranks from what all have tried; None where all have done it."""
        failed = None
        try:
            action()
        except (OSError, MemoryError) as error:
            cause = OSError(getattr(error, "errno", errno.ENOMEM), getattr(error, "strerror", None) or str(error) or type(error).__name__)
            failed = Failed(cause, f", rank {self._team.rank} on {platform.node()}" if self._team.size > 1 else "")
        if not self._team.max(float(failed is not None))[0]:
            return None
        return next(filter(None, self._team.all_gather(failed)))

    def _write(self, checkpoint: Checkpoint, alone: bool = False) -> None:
        """Write what belongs to an iteration; ``alone``: the end of its increment only."""
        self._unlink(self._stale)
        self._stale = []
        sync = checkpoint.ended or time.monotonic() - self._synced > SYNCED
        if checkpoint.ended:
            if checkpoint.notes["last"]:
                self._reserve_file.unlink(missing_ok=True)
            # first, so that no run goes on after an iteration that was the last
            self._write_file(f"increment-{checkpoint.increment:03}", checkpoint, sync)
        if self.keeps and not alone and not (checkpoint.ended and checkpoint.notes["met"]):
            self._write_file(f"iteration-{checkpoint.iteration:06}", checkpoint, sync)
        self._synced = time.monotonic() if sync else self._synced

    def _unlink(self, paths: Iterable[Path]) -> None:
        """Remove this rank's files among some, those of ranks that are no more too."""
        for path in list(paths):
            if rank_of(path) % self._team.size == self._team.rank:
                path.unlink(missing_ok=True)

    @property
    def _reserve_file(self) -> Path:
        return self._path / f"{RESERVE}-{self._team.rank}"

    def _reserve(self, checkpoint: Checkpoint) -> None:
        """Take the room that the end of the run will need: what is known now, and five fields of all load steps."""
        self._reserved = True
        if not self._team.rank:
            begun(self._folder)
        width = max(array.shape[1] for name, array in checkpoint.arrays.items() if kind_of(name) == "trace")
        size = sum(array.nbytes for array in checkpoint.arrays.values()) + 8 * 5 * checkpoint.notes["steps"] * width + MARGIN
        if not (error := self._tried(lambda: self._take(size))):
            return
        if error.cause.errno == errno.ENOENT:  # a node that does not see rank 0's folder
            self._go_on_without(error)
        elif not self._team.rank:
            with self._folder.guarded(f"what the end of the run will need{error.where},"):
                raise error.cause

    def _take(self, size: int) -> None:
        try:
            self._reserve_file.unlink(missing_ok=True)
            with open(self._reserve_file, "wb") as file:
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError:
            self._reserve_file.unlink(missing_ok=True)
            raise

    def _write_file(self, name: str, checkpoint: Checkpoint, sync: bool) -> None:
        """Replace this rank's file of a name; ``sync``: wait for the disk itself."""
        arrays = {**checkpoint.arrays, **self._columns}
        about = {"version": VERSION, "problem": self._fingerprint, "run": self._run, "iteration": checkpoint.iteration,
                 "increment": checkpoint.increment, "evaluations": checkpoint.evaluations, "notes": checkpoint.notes,
                 "arrays": sorted(arrays)}
        text = json.dumps(about, default=lambda number: number.item()).encode()
        path = self._path / f"{name}-{self._team.rank}of{self._team.size}.npz"
        temporary = path.with_name(f".{path.name}{UNFINISHED}")
        self._path.mkdir(exist_ok=True)
        temporary.unlink(missing_ok=True)  # nothing is written through a link
        try:
            with open(temporary, "wb") as file:
                np.savez(file, about=np.frombuffer(text, np.uint8), **arrays)
                file.flush()
                if sync:
                    os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
