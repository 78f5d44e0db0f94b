"""checkpoint.npz: the state to resume from, written now and then and when a run is interrupted."""

from __future__ import annotations

import hashlib
import json
import os
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.method.events import Finished, Iteration, Subscriber
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder

NAME = "checkpoint.npz"
SELDOM, OFTEN = 30.0, 2.0  # seconds between savings; with several ranks often: a launcher that ends them waits little
SPARING = 50  # pause between two savings at least, over the time that one takes
# When to stop, where to write and who computes may change between a run and its continuation.
_FREE = {"name", "output", "blackbox.workers", "blackbox.transport",
         "method.tolerance", "method.max_iterations"}


@dataclass(frozen=True)
class SavedState:
    """What a checkpoint holds.

    Parameters
    ----------
    state : (steps, dofs), the state s of the method
    iteration, sweeps, seconds : where the run stood
    """

    state: np.ndarray
    iteration: int
    sweeps: float
    seconds: float


class Checkpoint(Subscriber):
    """Keeps the last iteration and saves it regularly.

    A converged run removes the file; any other end saves the last state.

    Parameters
    ----------
    folder : where
    fingerprint : of the configuration, see ``fingerprint``
    every : seconds between two savings, or more where one takes long
    """

    wants_states = True

    def __init__(self, folder: ResultsFolder, fingerprint: str, every: float = SELDOM,
                 clock: Callable[[], float] = time.monotonic):
        self._folder, self._fingerprint, self._every, self._clock = folder, fingerprint, every, clock
        self._last: SavedState | None = None
        self._saved, self._pause = clock(), every

    def iteration(self, event: Iteration) -> None:
        # a copy: the loop may go on in the same memory while an interrupt asks for write()
        self._last = SavedState(np.array(event.state), event.iteration, event.sweeps, event.seconds)
        if self._clock() - self._saved >= self._pause:
            self.write()

    def finished(self, event: Finished) -> None:
        if event.converged:
            self._folder.remove(NAME)
            self._last = None
        else:
            self.write()

    def failed(self, error: BaseException) -> None:
        self.write()

    def write(self) -> Path | None:
        """Saves the last finished iteration now; None if there is none yet."""
        last = self._last
        if last is None:
            return None
        begin = self._clock()
        with self._folder.replacing(NAME) as temporary, open(temporary, "wb") as file:
            np.savez(file, state=last.state, iteration=last.iteration, sweeps=last.sweeps,
                     seconds=last.seconds, fingerprint=self._fingerprint)
            file.flush()
            os.fsync(file.fileno())  # it is there for the day the machine goes down
        self._saved = self._clock()
        self._pause = max(self._every, SPARING * (self._saved - begin))
        return self._folder / NAME


def load_checkpoint(folder: ResultsFolder | str | os.PathLike[str], fingerprint: str) -> SavedState:
    """Reads the checkpoint of a results folder.

    Raises
    ------
    InputError : none there, damaged, or written for another problem than ``fingerprint``
    """
    path = (folder.path if isinstance(folder, ResultsFolder) else Path(folder)) / NAME
    if not path.is_file():
        raise InputError(Problem(DIRECTORY_KEY, f"no {NAME} in {path.parent}",
                                 "the checkpoint of an interrupted run of this configuration",
                                 "run without --resume, or name the interrupted run's folder with --output"))
    try:
        with np.load(path, allow_pickle=False) as data:
            saved = SavedState(data["state"], int(data["iteration"]), float(data["sweeps"]),
                               float(data["seconds"]))
            theirs = str(data["fingerprint"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(Problem(DIRECTORY_KEY, f"{path} is damaged: {error}", "a checkpoint written by a run",
                                 f"remove {path} and run without --resume")) from error
    if theirs != fingerprint:
        raise InputError(Problem(
            DIRECTORY_KEY, f"{path} belongs to another problem (fingerprint {theirs[:12]}, now {fingerprint[:12]})",
            "the configuration and mesh of the interrupted run (tolerance, max_iterations, workers, "
            "transport and output may change)",
            "undo the changes, run without --resume, or choose another folder with --output"))
    return saved


def fingerprint(config: Mapping[str, object], *arrays: np.ndarray) -> str:
    """Hash of what the state depends on: the configuration (complete) and e.g. the mesh's nodes and cells.

    Tolerance, iteration limit, name, output, workers and transport are left out: a run may be
    resumed with others.
    """
    digest = hashlib.sha256(json.dumps(_relevant(config, ""), sort_keys=True, default=str).encode())
    for array in arrays:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _relevant(value: object, path: str) -> object:
    if path == "blackbox" and isinstance(value, list):
        return [_relevant(entry, path) for entry in value]
    if not isinstance(value, Mapping):
        return value
    inner = {str(key): (f"{path}.{key}" if path else str(key), item) for key, item in value.items()}
    return {key: _relevant(item, where) for key, (where, item) in inner.items() if where not in _FREE}
