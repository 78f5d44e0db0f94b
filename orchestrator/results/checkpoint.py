"""checkpoint/: what a run needs to go on where it stood.

- ``iteration-000001-0of1.npz`` …  a ``Checkpoint`` each, of several ranks each its own columns of it; the oldest go as soon as the
  acceleration needs them no more
- ``increment-000-0of1.npz`` …     the last one of each increment of load steps, with its fields
- ``problem.json``                 what the run's problem depends on, so that another one is told by what differs
- ``reserve-0`` …                  room for the end of the run, of each rank

Files are whole or not there, and carry checksums, and which columns of the whole scene's arrays are theirs: what some ranks have
left, any number of ranks goes on from. An iteration counts that all its ranks have written (``keeping`` writes them).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.errors import InputError, Problem, wrong
from orchestrator.method.checkpoint import COMMON, Checkpoint, Numbers, Start, kind_of
from orchestrator.written import read_arrays
from orchestrator.parallel.numbering import runs
from orchestrator.results.fingerprint import differences, digest_of
from orchestrator.results.folder import DIRECTORY_KEY, SHOWN, ResultsFolder

VERSION = 6
NAME, PROBLEM, RESERVE = "checkpoint", "problem.json", "reserve"
ITERATIONS, INCREMENTS = "iteration-*.npz", "increment-*.npz"
COLUMNS = "columns/"  # + kind: runs of the whole scene's columns (k, 2), where each begins and how long it is
_OWN = rf"{NAME}/((iteration-\d{{6,}}|increment-\d{{3,}})(-\d+of\d+)?\.npz|{RESERVE}(-\d+)?|problem\.json)"  # whatever a disk makes of them
_FRESH = "run without --resume, or name the interrupted run's folder with --output"


def begun(folder: ResultsFolder) -> None:
    """Note that a run has begun here: if it is killed before its first iteration, it resumes at its beginning."""
    with folder.guarded(NAME):
        (folder / NAME).mkdir(exist_ok=True)
        folder.manifest.claim(_OWN)


def saved(folder: ResultsFolder) -> bool:
    """Whether iterations are there to resume from."""
    return any(next((folder / NAME).glob(pattern), None) for pattern in (INCREMENTS, ITERATIONS))


def number_of(path: Path) -> int:
    """Which iteration, or increment, a file is of."""
    return int(path.stem.split("-")[1])


def rank_of(path: Path) -> int:
    """Which rank has written it."""
    return int((path.stem.split("-") + ["0"])[2].partition("of")[0])


@dataclass(frozen=True)
class Kept(Checkpoint):
    """A checkpoint of the whole scene, whose arrays stay in its files.

    files : of all ranks that wrote it
    widths : name → columns of the whole scene
    """

    files: tuple[Path, ...] = ()
    widths: Mapping[str, int] = field(default_factory=dict)

    def of_rank(self, numbers: Numbers) -> Checkpoint:
        """One rank's columns, from one file after the other; nan where there are none.

        Raises InputError: a file that was whole is so no more
        """
        arrays: dict[str, np.ndarray] = {}
        for path in self.files:
            try:
                theirs = read_file(path)[1].arrays
            except Exception as error:  # whatever a disk has made of it
                raise wrong(DIRECTORY_KEY, f"{path} cannot be read any more: {error}", "the checkpoint as it was", "try again") from error
            for name in self.widths:
                rows = arrays.setdefault(name, np.full((len(theirs[name]), len(numbers[kind_of(name)])), np.nan))
                there = _columns(theirs, kind_of(name))
                mine, at, of = np.intersect1d(numbers[kind_of(name)], there, return_indices=True)
                rows[:, at] = theirs[name][:, of]
            arrays |= {name: x for name, x in theirs.items() if kind_of(name) == COMMON}
        return Checkpoint(self.iteration, self.increment, self.evaluations, arrays, self.notes)


def columns_of(numbers: Numbers) -> dict[str, np.ndarray]:
    """What a file tells of its columns: runs (k, 2) of neighbours in the whole scene, where each begins, and how long it is."""
    return {COLUMNS + kind: np.column_stack([of[starts], np.diff([*starts, len(of)])])
            for kind, of in numbers.items() for starts in [np.flatnonzero(np.diff(of, prepend=-2) != 1)]}


def _columns(arrays: Mapping[str, np.ndarray], kind: str) -> np.ndarray:
    """(k,) int, which columns of the whole scene a file has."""
    return runs(*arrays[COLUMNS + kind].T)


def read_file(path: Path) -> tuple[dict[str, Any], Checkpoint]:
    """What is told about a file, ``problem`` and ``run`` as they are written, and the checkpoint: its rank's columns.

    Raises InputError: the file is of another version
    Raises Exception: of whatever kind, it cannot be read or is not as it was written
    """
    file = read_arrays(path)
    about = json.loads(bytes(file.pop("about")))
    if about["version"] != VERSION:
        raise wrong(DIRECTORY_KEY, f"{path} was written by another version of this program (version {about['version']})",
                    "a checkpoint of this version", "resume with that version, or run without --resume")
    if sorted(file) != about["arrays"]:
        raise ValueError("arrays are missing")
    return about, Checkpoint(about["iteration"], about["increment"], about["evaluations"], file, about["notes"])


def load_checkpoint(folder: ResultsFolder | str | os.PathLike[str], fingerprint: str, problem: Mapping[str, str] | None = None,
                    warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)) -> Start | None:
    """Where the run of a results folder stood; None where it has begun, but left no iteration that is whole.

    Files that are damaged are left out, and iterations that not all ranks have written: what they tell is computed again.

    problem : what the fingerprint is of, so that another problem is told by what differs
    warn : is told of damage
    Raises InputError: none there, or written for another problem than ``fingerprint``, or by another version
    """
    path = (folder.path if isinstance(folder, ResultsFolder) else Path(folder)) / NAME
    if not path.is_dir():
        raise wrong(DIRECTORY_KEY, f"no {NAME} in {path.parent}", "the checkpoint of an interrupted run of this configuration", _FRESH)
    increments, latest = ([kept for files in _together(path.glob(pattern)) if (kept := _sound(files, fingerprint, problem, warn))]
                          for pattern in (INCREMENTS, ITERATIONS))
    done: list[Checkpoint] = []
    for kept in increments:  # one after the other
        if kept.increment == len(done):
            done.append(kept)
    if done and done[-1].notes["last"] and not all(x.notes["met"] for x in done):
        return _after_a_failure(done, latest)
    window = _window([x for x in latest if x.increment == len(done)])
    return _between(done, window) if done or window else None


def _together(paths: Iterable[Path]) -> list[list[Path]]:
    """Files of all ranks of an iteration, or increment, in order."""
    groups = groupby(sorted(paths, key=lambda path: (number_of(path), path.stem.partition("of")[2], rank_of(path))),
                     key=lambda path: (number_of(path), path.stem.partition("of")[2]))
    return [list(files) for _, files in groups]


def _sound(files: list[Path], fingerprint: str, problem: Mapping[str, str] | None, warn: Callable[[str], None]) -> Kept | None:
    """What files of the ranks tell together, if all are there and sound."""
    first, runs, widths = None, [], {}
    for file in files:
        try:
            about, found = read_file(file)
            ends = {name: 1 + int(_columns(found.arrays, kind_of(name)).max(initial=-1)) for name in found.arrays
                    if kind_of(name) not in (COMMON, COLUMNS.rstrip("/"))}
        except InputError:
            raise
        except Exception as error:  # whatever a disk has made of it
            what = f"cannot be read: {file}: {error.strerror}" if isinstance(error, OSError) else f"is damaged: {file}"
            warn(f"The checkpoint {what}. What it told is computed again.")
            return None
        if about["problem"] != fingerprint:
            raise InputError(_another(file.parent, about["problem"], problem))
        first, widths = first or found, {name: max(end, widths.get(name, 0)) for name, end in ends.items()}
        runs.append(about["run"])
    written, _, size = runs[0]
    if sorted(runs) != [[written, rank, size] for rank in range(size)]:
        return None  # a rank was killed before it had written its part
    return Kept(first.iteration, first.increment, first.evaluations, {}, first.notes, tuple(files), widths)


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
    states = [x for x in done if x.notes["part"][1] == 1]
    return Start(states, last.iteration, last.notes["sweeps"], last.notes["seconds"], done[:sound])
