"""From the checkpoint in a results folder to where a run goes on from."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.method.memory import Memory
from orchestrator.method.start import Start
from orchestrator.results.fingerprint import differences, digest_of
from orchestrator.results.folder import DIRECTORY_KEY, SHOWN, ResultsFolder
from orchestrator.results.record_file import Damaged, OtherVersion, Record, read_record
from orchestrator.results.subscribers.checkpoint import ENDED, ITERATIONS, NAME, PROBLEM

_FRESH = "run without --resume, or name the interrupted run's folder with --output"


def load_checkpoint(folder: ResultsFolder | str | os.PathLike[str], fingerprint: str,
                    problem: Mapping[str, str] | None = None,
                    warn: Callable[[str], None] = lambda text: print(text, file=sys.stderr)) -> Start | None:
    """Reads the checkpoint of a results folder.

    Files that are damaged are left out: what they tell is computed again.

    Parameters
    ----------
    problem : what the fingerprint is of, so that another problem is told by what differs
    warn : is told of damage

    Returns
    -------
    where to go on from; None where a run has begun, but left no iteration that is whole

    Raises
    ------
    InputError : none there, or written for another problem than ``fingerprint``, or by another version
    """
    path = (folder.path if isinstance(folder, ResultsFolder) else Path(folder)) / NAME
    files = [sorted(path.glob(pattern)) for pattern in (ENDED, ITERATIONS)]
    if not path.is_dir():
        raise InputError(Problem(DIRECTORY_KEY, f"no {NAME} in {path.parent}",
                                 "the checkpoint of an interrupted run of this configuration", _FRESH))
    # read all the same: what belongs to another problem or version is refused
    ended, latest = ([record for file in some if (record := _sound(file, warn))] for some in files)
    for record in (*ended, *latest):
        if record.header["problem"] != fingerprint:
            raise InputError(_another(path, record.header["problem"], problem))
    done: list[Record] = []
    for record in ended:  # batches of load steps, one after the other
        if record.header["batch"] == len(done):
            done.append(record)
    if done and (done[-1].header["notes"]["last"] or not all(r.header["notes"]["met"] for r in done)):
        return _after_the_end(done, latest)
    window = _window([r for r in latest if r.header["batch"] == len(done)])
    return _between(done, window) if done or window else None


def _sound(file: Path, warn: Callable[[str], None]) -> Record | None:
    """What a file tells, if it is sound."""
    try:
        return read_record(file)
    except OtherVersion as error:
        raise InputError(Problem(DIRECTORY_KEY, f"{file} was written by another version of this program ({error})",
                                 "a checkpoint of this version", "resume with that version, or run without --resume")
                         ) from error
    except Damaged as error:
        warn(f"The checkpoint is damaged: {error}. What it told is computed again.")
    except OSError as error:
        warn(f"The checkpoint cannot be read: {file}: {error.strerror}. What it told is computed again.")
    return None


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


def _window(found: Sequence[Record]) -> list[Record]:
    """The last record after which a run can go on, and those before it that this takes; empty if there is none."""
    by_iteration = {record.header["iteration"]: record for record in found}
    for iteration in sorted(by_iteration, reverse=True):
        first = iteration - by_iteration[iteration].header["back"] + 1
        if all(i in by_iteration for i in range(first, iteration)):
            return [by_iteration[i] for i in range(first, iteration + 1)]
    return []


def _between(done: Sequence[Record], latest: Sequence[Record]) -> Start:
    """Where a run stood that was stopped."""
    last = (latest or done)[-1].header
    return Start(None, last["iteration"], last["notes"]["batch"]["sweeps"], last["notes"]["seconds"],
                 [_memory(r) for r in done], [_memory(r) for r in latest])


def _after_the_end(done: Sequence[Record], latest: Sequence[Record]) -> Start:
    """Where a run goes on whose iterations had ended: nowhere if it has converged; else from where it failed.

    A run of one batch goes on as if it had not stopped; of several, the first that has not converged begins anew from
    its last state, and so do those after it.
    """
    if all(r.header["notes"]["met"] for r in done):
        return _between(done, [])
    if len(done) == 1 and (window := _window(latest)) and window[-1].header["iteration"] >= done[0].header["iteration"] - 1:
        return _between([], window)
    memories, last = [_memory(r) for r in done], done[-1].header
    sound = next(i for i, r in enumerate(done) if not r.header["notes"]["met"])
    state = np.vstack([m.arrays["trace/delivered.s"] for m in memories])
    state = np.vstack([state, np.repeat(state[-1:], last["notes"]["steps"] - len(state), axis=0)])
    return Start(state, last["iteration"], last["notes"]["batch"]["sweeps"], last["notes"]["seconds"], memories[:sound])


def _memory(record: Record) -> Memory:
    header = record.header
    return Memory(header["iteration"], header["batch"], header["back"], record.arrays, header["notes"])
