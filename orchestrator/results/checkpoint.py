"""checkpoint/: what a run needs to go on where it stood.

- ``iteration-000001.npz`` …  a ``Checkpoint`` each; the oldest go as soon as the acceleration needs them no more
- ``increment-000.npz`` …     the last one of each increment of load steps, with its fields
- ``problem.json``            what the run's problem depends on, so that another one is told by what differs
- ``reserve``                 room for the end of the run

Files are whole or not there, and carry checksums; for the day the machine goes down, the disk itself is waited for every ``SYNCED``
seconds and at the end of each increment.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, Problem, wrong
from orchestrator.method.checkpoint import Checkpoint, Start
from orchestrator.method.events import Iteration, Subscriber
from orchestrator.packed import read_arrays
from orchestrator.results.fingerprint import differences, digest_of
from orchestrator.results.folder import DIRECTORY_KEY, SHOWN, ResultsFolder
from orchestrator.results.manifest import UNFINISHED

VERSION = 5
NAME, PROBLEM, RESERVE = "checkpoint", "problem.json", "reserve"
ITERATIONS, INCREMENTS = "iteration-*.npz", "increment-*.npz"
_OWN = rf"{NAME}/((iteration-\d{{6,}}|increment-\d{{3,}})\.npz|{RESERVE}|problem\.json)"  # whatever a disk makes of them
SYNCED = 30.0  # seconds between two waits for the disk itself
MARGIN = 1 << 16  # bytes for what is no array
_FRESH = "run without --resume, or name the interrupted run's folder with --output"


def begun(folder: ResultsFolder) -> None:
    """Note that a run has begun here: if it is killed before its first iteration, it resumes at its beginning."""
    with folder.guarded(NAME):
        (folder / NAME).mkdir(exist_ok=True)
        folder.manifest.claim(_OWN)


def saved(folder: ResultsFolder) -> bool:
    """Whether iterations are there to resume from."""
    return any(next((folder / NAME).glob(pattern), None) for pattern in (INCREMENTS, ITERATIONS))


class CheckpointWriter(Subscriber):
    """Writes every iteration to the results folder; ``remove`` it when all results are there.

    The room that the end of the run needs is taken at its first iteration: a run whose end would not fit is not worth
    computing. A disk that is full later ends no run: what is not needed any more is removed, and if that is too little
    the run goes on without, and says so.

    folder : where
    fingerprint : of the problem
    start : where the run goes on from what an earlier one has left here; None at the beginning
    warn : what is told to the user
    Raises InputError: from the first iteration, if there is no room for the end of the run
    """

    wants_checkpoints = True

    def __init__(self, folder: ResultsFolder, fingerprint: str, start: Start | None = None,
                 warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)):
        self._folder, self._path, self._fingerprint, self._warn = folder, folder / NAME, fingerprint, warn
        self._stale: list[Path] = []  # what begins anew, once it has
        if start is not None:
            self._stale = [path for path in self._path.glob(ITERATIONS) if _number(path) > start.iteration]
            self._stale += sorted(self._path.glob(INCREMENTS))[len(start.ended):] if start.state is not None else []
        self._reserved, self.keeps, self._synced = False, True, time.monotonic()

    def iteration(self, event: Iteration) -> None:
        checkpoint = event.checkpoint
        if checkpoint is None or not (self.keeps or checkpoint.ended):
            return
        if not self._reserved:
            with self._folder.guarded("what the end of the run will need"):
                self._reserve(checkpoint)
        try:
            self._keep(checkpoint)
        except (OSError, MemoryError) as first:
            try:
                if not checkpoint.ended:
                    raise
                _remove(self._path.glob(ITERATIONS))  # the end of an increment needs none of those before
                (self._path / RESERVE).unlink(missing_ok=True)
                self._keep(checkpoint, alone=True)
            except (OSError, MemoryError):
                if self.keeps:
                    self._warn(f"No checkpoint can be written in {self._path} ({getattr(first, 'strerror', None) or first}): the run "
                               "goes on without; if it is killed, --resume begins where the last checkpoint was.")
            self.keeps = False

    def remove(self) -> None:
        """All results are there: the checkpoint goes."""
        self._folder.remove(f"{NAME}/*")
        with suppress(OSError):
            self._path.rmdir()

    def _keep(self, checkpoint: Checkpoint, alone: bool = False) -> None:
        """Write what belongs to an iteration; ``alone``: the end of its increment only."""
        _remove(self._stale)
        self._stale = []
        sync = checkpoint.ended or time.monotonic() - self._synced > SYNCED
        if checkpoint.ended:
            if checkpoint.notes["last"]:
                (self._path / RESERVE).unlink(missing_ok=True)
            # first, so that no run goes on after an iteration that was the last
            _write(self._path / f"increment-{checkpoint.increment:03}.npz", self._fingerprint, checkpoint, sync)
        if checkpoint.ended and checkpoint.notes["met"]:
            _remove(self._path.glob(ITERATIONS))  # the results may need the room
        elif not alone and self.keeps:
            _write(self._path / f"iteration-{checkpoint.iteration:06}.npz", self._fingerprint, checkpoint, sync)
            first = checkpoint.iteration - max(checkpoint.evaluations, 1) + 1
            _remove(path for path in self._path.glob(ITERATIONS) if _number(path) < first)
        self._synced = time.monotonic() if sync else self._synced

    def _reserve(self, checkpoint: Checkpoint) -> None:
        """Take the room that the end of the run will need: what is known now, and five fields of all load steps."""
        self._reserved = True
        begun(self._folder)
        width = max(array.shape[1] for name, array in checkpoint.arrays.items() if name.startswith("trace"))
        size = sum(array.nbytes for array in checkpoint.arrays.values()) + 8 * 5 * checkpoint.notes["steps"] * width + MARGIN
        try:
            (self._path / RESERVE).unlink(missing_ok=True)
            with open(self._path / RESERVE, "wb") as file:
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError:
            (self._path / RESERVE).unlink(missing_ok=True)
            raise


def _number(path: Path) -> int:
    return int("0" + "".join(filter(str.isdigit, path.stem)))


def _remove(paths: Iterable[Path]) -> None:
    for path in list(paths):
        path.unlink(missing_ok=True)


def _write(path: Path, fingerprint: str, checkpoint: Checkpoint, sync: bool) -> None:
    """Replace a file; ``sync``: wait for the disk itself."""
    about = {"version": VERSION, "problem": fingerprint, "iteration": checkpoint.iteration, "increment": checkpoint.increment,
             "evaluations": checkpoint.evaluations, "notes": checkpoint.notes, "arrays": sorted(checkpoint.arrays)}
    text = json.dumps(about, default=lambda number: number.item()).encode()
    temporary = path.with_name(f".{path.name}{UNFINISHED}")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary.unlink(missing_ok=True)  # nothing is written through a link
    try:
        with open(temporary, "wb") as file:
            np.savez(file, about=np.frombuffer(text, np.uint8), **checkpoint.arrays)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_file(path: Path) -> tuple[str, Checkpoint]:
    """Fingerprint of the problem, and checkpoint.

    Raises InputError: the file is of another version
    Raises Exception: of whatever kind, it cannot be read or is not as it was written
    """
    file = read_arrays(path)
    about = json.loads(bytes(file["about"]))
    if about["version"] != VERSION:
        raise wrong(DIRECTORY_KEY, f"{path} was written by another version of this program (version {about['version']})",
                    "a checkpoint of this version", "resume with that version, or run without --resume")
    arrays = {name: file[name] for name in about["arrays"]}
    return about["problem"], Checkpoint(about["iteration"], about["increment"], about["evaluations"], arrays, about["notes"])


def load_checkpoint(folder: ResultsFolder | str | os.PathLike[str], fingerprint: str, problem: Mapping[str, str] | None = None,
                    warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)) -> Start | None:
    """Where the run of a results folder stood; None where it has begun, but left no iteration that is whole.

    Files that are damaged are left out: what they tell is computed again.

    problem : what the fingerprint is of, so that another problem is told by what differs
    warn : is told of damage
    Raises InputError: none there, or written for another problem than ``fingerprint``, or by another version
    """
    path = (folder.path if isinstance(folder, ResultsFolder) else Path(folder)) / NAME
    if not path.is_dir():
        raise wrong(DIRECTORY_KEY, f"no {NAME} in {path.parent}", "the checkpoint of an interrupted run of this configuration", _FRESH)
    increments, latest = ([found for file in sorted(path.glob(pattern)) if (found := _sound(path, file, fingerprint, problem, warn))]
                          for pattern in (INCREMENTS, ITERATIONS))
    done: list[Checkpoint] = []
    for found in increments:  # one after the other
        if found.increment == len(done):
            done.append(found)
    if done and done[-1].notes["last"] and not all(x.notes["met"] for x in done):
        return _after_a_failure(done, latest)
    window = _window([x for x in latest if x.increment == len(done)])
    return _between(done, window) if done or window else None


def _sound(path: Path, file: Path, fingerprint: str, problem: Mapping[str, str] | None, warn: Callable[[str], None]) -> Checkpoint | None:
    """What a file tells, if it is sound."""
    try:
        theirs, found = read_file(file)
    except InputError:
        raise
    except Exception as error:  # whatever a disk has made of it
        what = f"cannot be read: {file}: {error.strerror}" if isinstance(error, OSError) else f"is damaged: {file}"
        warn(f"The checkpoint {what}. What it told is computed again.")
        return None
    if theirs != fingerprint:
        raise InputError(_another(path, theirs, problem))
    return found


def _another(path: Path, theirs: str, problem: Mapping[str, str] | None) -> Problem:
    """What is said of a checkpoint of another problem; what differs, where that is known."""
    try:
        before = json.loads((path / PROBLEM).read_bytes())
        changed = differences(before, problem) if problem and digest_of(before) == theirs else []
    except (OSError, ValueError, TypeError, AttributeError):
        changed = []
    what = "; ".join(changed[:SHOWN]) + (f"; and {len(changed) - SHOWN} more" if len(changed) > SHOWN else "")
    return Problem(DIRECTORY_KEY, f"{path} belongs to another problem" + (f": {what}" if changed else ""),
                   "the configuration, the mesh and the files of the interrupted run (tolerance, max_iterations, workers, "
                   "transport, timeout and output may change)",
                   "undo the changes, run without --resume, or choose another folder with --output")


def _window(found: Sequence[Checkpoint]) -> list[Checkpoint]:
    """The last checkpoint after which a run can go on, and those before it that this takes; empty if there is none."""
    known = {x.iteration: x for x in found}
    for last in sorted(known, reverse=True):
        needed = range(last - max(known[last].evaluations, 1) + 1, last + 1)
        if all(i in known for i in needed):
            return [known[i] for i in needed]
    return []


def _between(done: Sequence[Checkpoint], latest: Sequence[Checkpoint]) -> Start:
    """Where a run stood that was stopped."""
    last = (latest or done)[-1]
    return Start(None, last.iteration, last.notes["sweeps"], last.notes["seconds"], done, latest)


def _after_a_failure(done: Sequence[Checkpoint], latest: Sequence[Checkpoint]) -> Start:
    """Where a run goes on that has ended without converging: one increment as if it had not stopped; of several the first that has
    not converged begins anew from its last state, and so do those after it."""
    if len(done) == 1 and (window := _window(latest)) and window[-1].iteration >= done[0].iteration - 1:
        return _between([], window)
    last, sound = done[-1], next(i for i, x in enumerate(done) if not x.notes["met"])
    state = np.vstack([x.arrays["trace/delivered.s"] for x in done if x.notes["part"][1] == 1])
    return Start(state, last.iteration, last.notes["sweeps"], last.notes["seconds"], done[:sound])
