"""checkpoint/: what a run needs to go on where it stood, as files.

- ``iteration-000001.npz`` …  a ``Checkpoint`` of the whole scene each. Those go that the
  acceleration needs no more; the last one of each increment of load steps stays
- ``problem.json``  what the run's problem depends on, so that another is told by what differs
- ``reserve``       room for the end of the run

Files are whole or not there, and carry checksums: any number of ranks goes on from them.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any


from orchestrator.errors import InputError, Problem, wrong
from orchestrator.method.checkpoint import COMMON, Checkpoint, Numbers, Start, kind_of
from orchestrator.folders import read_arrays
from orchestrator.results.fingerprint import differences, digest_of
from orchestrator.results.folder import DIRECTORY_KEY, SHOWN, ResultsFolder
from orchestrator.results.manifest import CHECKPOINT

VERSION = 10  # of what is in the files: part of the problem, see ``Record``
NAME, PROBLEM, RESERVE, FILES = "checkpoint", "problem.json", "reserve", "iteration-*.npz"
TOLD = [f.name for f in fields(Checkpoint) if f.name != "arrays"]
_FRESH = "run without --resume, or name the interrupted run's folder with --output"
Warn = Callable[[str], None]


def begun(folder: ResultsFolder) -> None:
    """Note that a run has begun here: killed before an iteration, it resumes at its beginning."""
    with folder.guarded(NAME):
        (folder / NAME).mkdir(exist_ok=True)
        folder.manifest.claim(CHECKPOINT)


def saved(folder: ResultsFolder) -> bool:
    """Return whether iterations are there to resume from."""
    return any((folder / NAME).glob(FILES))


@dataclass(frozen=True)
class Kept(Checkpoint):
    """A checkpoint of the whole scene, whose arrays stay in its file.

    file : which
    widths : name → columns of the whole scene
    """

    file: Path = Path()
    widths: Mapping[str, int] = field(default_factory=dict)

    def of_rank(self, numbers: Numbers) -> Checkpoint:
        """Return one rank's columns.

        Raises InputError: a file that was whole is so no more
        """
        try:
            whole = read_file(self.file)[1].arrays
        except Exception as error:  # whatever a disk has made of it
            raise wrong(DIRECTORY_KEY, f"{self.file} cannot be read any more: {error}",
                        "the checkpoint as it was", "try again") from error
        arrays = {name: x if kind_of(name) == COMMON else x[:, numbers[kind_of(name)]]
                  for name, x in whole.items()}
        return Checkpoint(self.iteration, self.increment, self.evaluations, arrays, self.notes)


def read_file(path: Path) -> tuple[dict[str, Any], Checkpoint]:
    """Return what is told about a file, and the checkpoint.

    Raises Exception: of whatever kind, it cannot be read or is not as it was written
    """
    file = read_arrays(path)
    about = json.loads(bytes(file.pop("about")))
    if sorted(file) != about["arrays"]:
        raise ValueError("arrays are missing")
    return about, Checkpoint(arrays=file, **{name: about[name] for name in TOLD})


def load_checkpoint(folder: ResultsFolder | str | os.PathLike[str], fingerprint: str,
                    problem: Mapping[str, str] | None = None,
                    warn: Warn = lambda text: print(text, file=sys.stderr)) -> Start | None:
    """Return where the run of a results folder stood; None where no iteration of it is whole.

    Files that are damaged are left out: what they tell is computed again.

    problem : what the fingerprint is of, so that another problem is told by what differs
    warn : is told of damage
    Raises InputError: none there, or written for another problem than ``fingerprint``
    """
    path = (folder.path if isinstance(folder, ResultsFolder) else Path(folder)) / NAME
    if not path.is_dir():
        raise wrong(DIRECTORY_KEY, f"no {NAME} in {path.parent}",
                    "the checkpoint of an interrupted run of this configuration", _FRESH)
    files = sorted(path.glob(FILES), key=number)
    read = (_sound(file, fingerprint, problem, warn) for file in files)
    found = [kept for kept in read if kept is not None]
    done: list[Kept] = []
    for kept in found:  # one increment after the other
        if kept.ended and kept.increment == len(done):
            done.append(kept)
    states, latest = None, _window([x for x in found if x.increment == len(done)])
    if done and done[-1].notes["last"] and not all(x.notes["met"] for x in done):
        latest = _window(found) if len(done) == 1 else []
        if latest and latest[-1].iteration >= done[0].iteration - 1:  # as if it had not stopped
            done = []
        else:  # the first that has not converged, and those after it, begin with their last states
            last = done[-1]
            states = [x for x in done if x.notes["part"][1] == 1]
            done = done[:next(i for i, x in enumerate(done) if not x.notes["met"])]
            return Start(states, last.iteration, last.notes["sweeps"], last.notes["seconds"], done,
                         origin=last.notes["origin"])
    if not done and not latest:
        return None
    last = (latest or done)[-1]
    return Start(None, last.iteration, last.notes["sweeps"], last.notes["seconds"], done, latest,
                 last.notes["origin"])


def number(file: Path) -> int:
    """Return the iteration that a file's name tells; −1 where it tells none."""
    last = file.stem.rpartition("-")[2]
    return int(last) if last.isdigit() else -1


def _sound(file: Path, fingerprint: str, problem: Mapping[str, str] | None,
           warn: Warn) -> Kept | None:
    """Return what a file tells, if it is sound."""
    try:
        about, found = read_file(file)
        widths = {name: x.shape[1] for name, x in found.arrays.items() if kind_of(name) != COMMON}
    except Exception as error:  # whatever a disk has made of it
        what = f"is damaged: {file}"
        if isinstance(error, OSError):
            what = f"cannot be read: {file}: {error.strerror}"
        warn(f"The checkpoint {what}. What it told is computed again.")
        return None
    if about["problem"] != fingerprint:
        raise InputError(_another(file.parent, about["problem"], problem))
    return Kept(found.iteration, found.increment, found.evaluations, {}, found.notes, file, widths)


def _another(path: Path, theirs: str, problem: Mapping[str, str] | None) -> Problem:
    """Return what is said of a checkpoint of another problem; what differs, where that is known."""
    try:
        before = json.loads((path / PROBLEM).read_bytes())
        changed = differences(before, problem) if problem and digest_of(before) == theirs else []
    except (OSError, ValueError, TypeError, AttributeError):
        changed = []
    more = f"; and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
    what = f": {'; '.join(changed[:SHOWN])}{more}" if changed else ""
    return Problem(DIRECTORY_KEY, f"{path} belongs to another problem{what}",
                   "the configuration, the mesh and the files of the interrupted run (tolerance, "
                   "max_iterations, workers, transport, timeout and output may change)",
                   "undo the changes, run without --resume, or choose another folder with --output")


def _window(found: Sequence[Kept]) -> list[Kept]:
    """Return the last checkpoint after which a run can go on, after those that this takes."""
    known = {x.iteration: x for x in found if x.goes_on}
    for last in sorted(known, reverse=True):
        needed = range(last - max(known[last].evaluations, 1) + 1, last + 1)
        if all(i in known for i in needed):
            return [known[i] for i in needed]
    return []
