"""history.csv: one line per iteration, on disk as soon as the iteration ends.

Rank 0's view of several ranks: states for its subscribers, fields of the interfaces of all.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from orchestrator.errors import InputError, wrong
from orchestrator.method.checkpoint import COMMON, kind_of, Numbers
from orchestrator.method.delivery.interface_fields import ALONG, InterfaceFields
from orchestrator.method.events import (
    COUNTED, Finished, HISTORY_COLUMNS, Iteration, Subscriber, Subscribers)
from orchestrator.parallel.team import Team
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder


NAME = "history.csv"
_COUNTS = {"iteration", *COUNTED}
_WITHOUT = "if it is damaged, remove it: --resume goes on without its lines"


class HistoryWriter(Subscriber):
    """Append every iteration to history.csv.

    folder : where
    resume_after : iteration of the checkpoint a run resumes from: lines up to it are kept,
        later ones (run after the checkpoint, then lost) dropped; None starts a new file
    whole : whether every line so far found room
    """

    def __init__(self, folder: ResultsFolder, resume_after: int | None = None):
        self._folder, self._over = folder, False
        self._known: dict[str, list] = {name: [] for name in HISTORY_COLUMNS}
        if resume_after is not None and (folder / NAME).exists():
            history = read_history(folder / NAME)
            keep = history["iteration"] <= resume_after
            self._known = {name: list(column[keep]) for name, column in history.items()}
        self._begin()

    def _begin(self) -> None:
        self.whole = True
        write_history(self._folder, self._known)
        with self._folder.guarded(NAME):
            self._folder.manifest.claim(re.escape(NAME))  # it grows
            self._file = open(self._folder / NAME, "ab", buffering=0)

    def iteration(self, event: Iteration) -> None:
        if self._over:
            return
        row = event.row
        if list(row) != list(self._known):  # the first one tells which laws there are
            self._file.close()
            unknown = [np.nan] * len(self._known["iteration"])
            self._known = {name: self._known.get(name, unknown[:]) for name in row}
            with suppress(InputError):  # full disk, as below
                self._begin()
        for name, value in row.items():
            self._known[name].append(value)
        if self.whole and not self._file.closed:
            self._append(_line(row.values()))

    def _append(self, line: bytes) -> None:
        size = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line):]
        except OSError:  # a full disk: what is computed is worth more than its history
            self._file.truncate(size)  # no half a line
            self.whole = False

    def complete(self) -> None:
        """Write the whole file again, if lines found no room or somebody has removed it."""
        if not self.whole or self._file.closed or not (self._folder / NAME).exists():
            write_history(self._folder, self._known)
            self.whole = True

    def close(self) -> None:
        """Close the file; later events are ignored."""
        self._over = True
        self._file.close()
        with suppress(OSError):  # a full disk: it stays claimed
            self._folder.manifest.settle(re.escape(NAME))


def columns(events: Sequence[Iteration]) -> dict[str, np.ndarray]:
    """Iterations as ``read_history`` gives them: column name → (iterations,) array."""
    rows = [event.row for event in events]
    return {name: np.array([row[name] for row in rows], int if name in _COUNTS else float)
            for name in (rows[0] if rows else HISTORY_COLUMNS)}


def write_history(folder: ResultsFolder, history: Mapping[str, Iterable]) -> Path:
    """Write a whole history (column name → (iterations,) values; {} for none) atomically."""
    lines = [_line(list(history) or HISTORY_COLUMNS), *map(_line, zip(*history.values()))]
    return folder.write(NAME, b"".join(lines))


def read_history(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Read a history.csv, or the one in a results folder.

    Returns column name → (iterations,) array, int for counts and float for the rest. A last line
    cut short by a killed run is left out.
    Raises InputError: missing file, or not a history
    """
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    try:
        head, *lines = path.read_text().split("\n")
        names = head.split(",")
        missing = [name for name in HISTORY_COLUMNS if name not in names]
        if missing:
            raise wrong(DIRECTORY_KEY,
                        f"the first line of {path} lacks the columns {', '.join(missing)}",
                        "a history.csv of this version",
                        "go on with the version that wrote it, or begin anew in another folder; "
                        f"{_WITHOUT}")
        # What follows the last line end is empty, or half a line.
        texts = [line.split(",") for line in lines[:-1]]
        table = np.array([[float(x) for x in row] for row in texts]).reshape(-1, len(names))
    except (OSError, ValueError) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read as a history: {error}",
                    "a history.csv written by a run",
                    f"name the results folder of an earlier run; {_WITHOUT}") from error
    whole = _COUNTS | {name for name, *column in zip(names, *texts) if column
                       and all(map(str.isdigit, column))}
    return {name: column.astype(int) if name in whole else column
            for name, column in zip(names, table.T)}


def _line(values: Iterable[object]) -> bytes:
    # repr of a Python number is the shortest text that reads back to the same bits
    texts = [v if isinstance(v, str) else repr(np.asarray(v).item()) for v in values]
    return (",".join(texts) + "\n").encode()


def interfaces_of_all(own: InterfaceFields | None, team: Team) -> InterfaceFields | None:
    """Return the fields of all ranks' interfaces, in the order of the scene, on rank 0; elsewhere
    its own.
    """
    told = team.gather(own)
    if own is None or told is None or len(told) == 1:
        return own
    nodes, names = (np.cumsum([0, *(len(getattr(x, of)) for x in told)])
                    for of in ("nodes", "names"))
    told = [replace(x, triangles=x.triangles + node, owner=x.owner + name)
            for x, node, name in zip(told, nodes, names)]
    every = {name: np.concatenate([getattr(x, name) for x in told], axis=axis)
             for name, (_, axis) in ALONG.items() if getattr(own, name) is not None}
    offsets = np.append(0, np.cumsum(np.concatenate([np.diff(x.offsets) for x in told])))
    variables = {name: np.concatenate([x.own[name] for x in told], axis=1) for name in own.own}
    joined = replace(own, **every, offsets=offsets, own=variables)
    return joined.some(np.argsort(joined.index))


class OnRanks(Subscriber):
    """Rank 0's subscribers, on all ranks: states and checkpoints come together for who wants them.

    The volume is that of all traces, to one rank: right for some hundreds of ranks.

    numbers : which columns of the whole scene's arrays are this rank's
    """

    def __init__(self, subscribers: Sequence[Subscriber], numbers: Numbers, team: Team):
        self.team, self.told = team, Subscribers(subscribers)
        wanted = [any(s.wants_states for s in subscribers),
                  any(s.wants_checkpoints for s in subscribers)]
        self.wanted = team.share(wanted if team.size > 1 else [False, False])
        self.numbers = team.gather(numbers)

    def iteration(self, event: Iteration) -> None:
        states, checkpoints = self.wanted
        if states:
            event = replace(event, state=self._whole("trace", event.state))
        if checkpoints and event.checkpoint is not None:
            arrays = {name: self._whole(kind_of(name), x)
                      for name, x in event.checkpoint.arrays.items()}
            event = replace(event, checkpoint=replace(event.checkpoint, arrays=arrays))
        self.told.iteration(event)

    def _whole(self, kind: str, part: np.ndarray) -> np.ndarray | None:
        """Return on rank 0 an array of the whole scene, from every rank's columns."""
        if kind == COMMON:
            return part
        arrived = self.team.gather(part)
        if arrived is None:
            return None
        columns = [own[kind] for own in self.numbers]
        whole = np.zeros((len(part), 1 + max(own.max(initial=-1) for own in columns)), part.dtype)
        for theirs, own in zip(arrived, columns):
            whole[:, own] = theirs
        return whole

    def warned(self, sentence: str) -> None:
        self.told.warned(sentence)

    def finished(self, event: Finished) -> None:
        self.told.finished(event)
