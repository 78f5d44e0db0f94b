"""history.csv: one line per iteration, on disk as soon as the iteration ends."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.method.events import HISTORY_COLUMNS, Iteration, Subscriber
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder

NAME = "history.csv"
_COUNTS = {"iteration", "open", "stick", "slip"}


class HistoryWriter(Subscriber):
    """Appends every iteration to history.csv.

    Parameters
    ----------
    folder : where
    resume_after : iteration of the checkpoint a run resumes from: lines up to it are kept,
        later ones (run after the checkpoint, then lost) dropped; None starts a new file
    """

    def __init__(self, folder: ResultsFolder, resume_after: int | None = None):
        self._folder = folder
        kept: dict[str, np.ndarray] | None = None
        if resume_after is not None and (folder / NAME).exists():
            history = read_history(folder / NAME)
            keep = history["iteration"] <= resume_after
            kept = {name: column[keep] for name, column in history.items()}
        write_history(folder, kept or {})
        with folder.guarded(NAME):
            self._file = open(folder / NAME, "ab", buffering=0)

    def iteration(self, event: Iteration) -> None:
        if not self._file.closed:
            self._append(_line([getattr(event, name) for name in HISTORY_COLUMNS]))

    def _append(self, line: bytes) -> None:
        with self._folder.guarded(NAME):
            size = self._file.seek(0, os.SEEK_END)
            try:
                while line:
                    line = line[self._file.write(line):]
            except OSError:
                self._file.truncate(size)  # no half a line on a full disk
                raise

    def close(self) -> None:
        """Closes the file; later events are ignored."""
        self._file.close()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write_history(folder: ResultsFolder, history: dict[str, np.ndarray]) -> Path:
    """Writes a whole history (column name → (iterations,) array; {} for none) atomically."""
    rows = zip(*(history[name] for name in HISTORY_COLUMNS)) if history else ()
    return folder.write(NAME, b"".join([_line(HISTORY_COLUMNS), *map(_line, rows)]))


def read_history(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Reads a history.csv, or the one in a results folder.

    Returns
    -------
    column name → (iterations,) array, int for counts and float for the rest. A last line cut
    short by a killed run is left out.

    Raises
    ------
    InputError : missing file, or not a history
    """
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    try:
        head, *lines = path.read_text().split("\n")
        names = head.split(",")
        missing = [name for name in HISTORY_COLUMNS if name not in names]
        if missing:
            raise ValueError(f"its first line lacks the columns {', '.join(missing)}")
        # What follows the last line end is empty, or half a line.
        table = np.array([[float(x) for x in line.split(",")] for line in lines[:-1]])
        table = table.reshape(-1, len(names))
    except (OSError, ValueError) as error:
        raise InputError(Problem(DIRECTORY_KEY, f"{path} cannot be read as a history: {error}",
                                 "a history.csv written by a run",
                                 "name the results folder of an earlier run")) from error
    return {name: column.astype(int) if name in _COUNTS else column
            for name, column in zip(names, table.T)}


def _line(values: list[object] | tuple[object, ...]) -> bytes:
    # repr of a Python number is the shortest text that reads back to the same bits
    texts = [v if isinstance(v, str) else repr(getattr(v, "item", lambda v=v: v)()) for v in values]
    return (",".join(texts) + "\n").encode()
