"""The results folder: created once, for one run at a time, every file in it written whole or not at
all.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path

from orchestrator.errors import InputError, Problem, SHOWN, wrong
from orchestrator.results.manifest import (
    FOLDERS, NAME as LIST, OWN, PARTS, RESULTS, UNFINISHED, Manifest)

DIRECTORY_KEY = ("output", "directory")
_FULL = {errno.ENOSPC, errno.EDQUOT}


class ResultsFolder:
    """A folder that takes the results of one run; files in it that are not this program's are
    neither removed nor replaced.

    directory : where; created with its parents if missing
    Raises InputError: it cannot be created or written to; later, from any writing, also when the
    disk is full
    """

    def __init__(self, directory: str | os.PathLike[str]):
        self.path = Path(directory)
        self.manifest = Manifest(self.path)
        with self.guarded("the folder itself"):
            self.path.mkdir(parents=True, exist_ok=True)
            # Permission bits say nothing to root or on read-only mounts: only writing tells.
            probe = self.path / f".probe{UNFINISHED}"
            try:
                probe.unlink(missing_ok=True)  # a link to another file would be written through
                probe.write_bytes(b"")
            finally:
                with suppress(OSError):
                    probe.unlink()
        for name in (OWN, LIST):
            if (self.path / name).is_symlink():
                raise wrong(DIRECTORY_KEY, f"{self.path / name} is a link",
                            "this program's own list of what it has written here",
                            "remove the link, or choose another folder with --output")
        for name in (OWN, *FOLDERS):  # now, not when all has been computed
            if os.path.lexists(self.path / name) and not (self.path / name).is_dir():
                raise wrong(DIRECTORY_KEY,
                            f"{self.path / name} is no folder, and a run needs one of that name",
                            "a folder that can be created and written to",
                            f"rename {name}, or choose another folder with --output")

    def __repr__(self) -> str:
        return f"ResultsFolder({str(self.path)!r})"

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @contextmanager
    def guarded(self, what: str) -> Iterator[None]:
        """Turns any OSError of the block into an InputError that names ``what`` was being
        written.
        """
        try:
            yield
        except OSError as error:
            raise InputError(_problem(self.path, what, error)) from error

    @contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Atomic writing: yields a temporary path that becomes ``name`` when the block succeeds.

        On any failure, an interrupt included, the temporary file is removed and what stood
        under ``name`` before stays.

        Raises InputError: disk full or folder not writable; what stands there is not this program's
        """
        target = self.path / name
        temporary = target.with_name(f".{target.name}{UNFINISHED}")
        with self.guarded(name):
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                temporary.unlink(missing_ok=True)  # nothing is written through a link
                yield temporary
                if os.path.lexists(target) and not self.manifest.owns(name):
                    raise InputError(_in_the_way(self.path, [name]))
                self.manifest.note(name, temporary)
                os.replace(temporary, target)
            finally:
                with suppress(OSError):
                    temporary.unlink()

    def write(self, name: str, content: bytes | str) -> Path:
        """Writes ``content`` under ``name`` in one atomic go and returns its path."""
        with self.replacing(name) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        return self.path / name

    def write_table(self, name: str, rows: Iterable[Sequence[object]]) -> Path:
        """Writes rows, the head first, as a table of comma-separated values."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        return self.write(name, text.getvalue())

    def remove(self, *patterns: str) -> None:
        """Removes those of this program's files that match the shell patterns; those that are
        missing are no error.
        """
        with self.guarded("the list of its files"):
            mine = [name for name in self.manifest.owned()
                    if any(fnmatchcase(name, pattern) for pattern in patterns)]
        for name in mine:
            with self.guarded(name):
                (self.path / name).unlink(missing_ok=True)

    def check_free(self, pattern: str = RESULTS) -> None:
        """Whether names that match the regular expression can be written under.

        Raises InputError: files that are not this program's, or were changed since, are in the way
        """
        with self.guarded("the list of its files"):
            if foreign := self.manifest.foreign(pattern):
                raise InputError(_in_the_way(self.path, foreign))

    def clear(self) -> None:
        """Removes what earlier runs left here, and nothing else: call it before a fresh run.

        Raises InputError: files that are not this program's are in the way; nothing is removed then
        """
        self.check_free()
        self.remove("*")
        for place in ("", *FOLDERS):  # of a run that was killed while it wrote
            for path in (self.path / place).glob(f".*{UNFINISHED}"):
                with self.guarded(path.name):
                    path.unlink(missing_ok=True)
        with self.guarded("the list of its files"):
            self.manifest.clean()

    @contextmanager
    def of_part(self, name: str) -> Iterator[Path]:
        """The empty folder parts/``name``, for a program of the user's: what it leaves there
        becomes this program's to remove.

        Raises InputError: folder not writable; files that no such run has left there
        """
        path, pattern = self.path / PARTS / name, of_parts([name])
        self.check_free(pattern)
        self.remove(f"{PARTS}/{name}/*")
        with self.guarded(f"{PARTS}/{name}"):
            for below in sorted(path.glob("**/"), reverse=True):
                below.rmdir()
            path.mkdir(parents=True)
            self.manifest.claim(pattern)
            try:
                yield path
            finally:
                self.manifest.settle(pattern)


def read_table(path: Path, columns: Iterable[str]) -> list[list[str]]:
    """Rows of a table that has these columns, the head first; none where there is no such file;
    raises InputError: it cannot be read, or is not whole.
    """
    if not path.is_file():
        return []
    try:
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
        if not rows or not {*rows[0]} >= {*columns} or {*map(len, rows)} != {len(rows[0])}:
            raise ValueError("columns or ends of rows are missing")
    except (OSError, ValueError, csv.Error) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}",
                    "a table that a run has written", "run the configuration again") from error
    return rows


def of_parts(names: Sequence[str]) -> str:
    """Pattern of the files that programs which are parts leave, for ``check_free``."""
    return f"{PARTS}/({'|'.join(map(re.escape, names))})/.*"


def _in_the_way(directory: Path, names: Sequence[str]) -> Problem:
    what = f"{len(names)} files" if len(names) > 1 else "a file"
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    shown = ", ".join(sorted(names)[:SHOWN])
    return Problem(DIRECTORY_KEY,
                   f"{what} in {directory} not written by this program, or changed since: "
                   f"{shown}{more}",
                   "a folder in which the names of results are free",
                   "rename or remove what is yours, or choose another folder with --output")


def _problem(directory: Path, what: str, error: OSError) -> Problem:
    free = None
    # the nearest one that is there
    for folder in reversed((directory, *directory.absolute().parents)):
        with suppress(OSError):
            free = shutil.disk_usage(folder).free
    # Some writers (numpy's tofile, Pillow) lose the error number: then only the free space tells.
    if error.errno in _FULL or (error.errno is None and free is not None and free < 1 << 20):
        left = "" if free is None else f", {free / 1e6:,.0f} MB free"
        over = "disk quota exceeded" if error.errno == errno.EDQUOT else "disk full"
        return Problem(DIRECTORY_KEY, f"{over} while writing {what} in {directory}{left}",
                       "room for the results",
                       "free some space (--resume computes nothing again that has been computed), "
                       "choose another folder with --output, or set output.fields: false")
    return Problem(DIRECTORY_KEY, f"cannot write {what} in {directory}: {error.strerror or error}",
                   "a folder that can be created and written to",
                   "check the path and its permissions, or choose another folder with --output")


LOCK, HOLDER = f"{OWN}/lock", f"{OWN}/holder.json"


@contextmanager
def locked(folder: ResultsFolder) -> Iterator[None]:
    """Holds the folder's lock: the system gives it back however the run ends, so that no lock is
    ever stale.

    Raises InputError: another run holds it; the message names that run
    """
    from filelock import FileLock, Timeout

    lock, about = FileLock(folder / LOCK, timeout=0), {"pid": os.getpid(), "host": platform.node(),
                                                       "since": time.strftime("%F %T")}
    with folder.guarded(LOCK):
        (folder / LOCK).parent.mkdir(exist_ok=True)
        try:
            lock.acquire()
        except Timeout:
            holder = "a process that has just begun"
            with suppress(OSError, ValueError, KeyError, TypeError):
                other = json.loads((folder / HOLDER).read_bytes())
                holder = f"process {other['pid']} on {other['host']}, since {other['since']}"
            raise wrong(
                DIRECTORY_KEY,
                f"another run writes to {folder.path}: {holder}",
                "a folder of its own for every run",
                "wait for that run, end it, or choose another folder with --output",
            ) from None
    try:
        with suppress(OSError):  # a full disk still locks; nothing is written through a link
            with open(folder / HOLDER, "w",
                      opener=lambda path, flags: os.open(path, flags | os.O_NOFOLLOW,
                                                         0o644)) as file:
                json.dump(about, file)
        yield
    finally:
        with suppress(OSError):
            (folder / HOLDER).unlink()
        lock.release()
