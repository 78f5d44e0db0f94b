"""The results folder: created once, every file in it written whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from orchestrator.errors import InputError, Problem

DIRECTORY_KEY = ("output", "directory")
_FOLDERS = ("fields", "figures", "checkpoint")
_FULL = {errno.ENOSPC, errno.EDQUOT}
# What a run writes; removed before a fresh one so that old and new results never mix.
_PRODUCTS = ("summary.json", "history.csv", "checkpoint/*", "traceback.txt", "fields.npz", "report.md", "report.html",
             "extremes.csv", "interfaces.csv", "probes.csv", "result.html",
             "fields/*.vtu", "fields/*.pvtu", "fields/*.pvd", "figures/*.png", ".*.part", "*/.*.part")


class ResultsFolder:
    """A folder that takes the results of one run.

    Parameters
    ----------
    directory : where; created with its parents if missing

    Raises
    ------
    InputError : it cannot be created or written to; later, from any writing, also when the disk is full
    """

    def __init__(self, directory: str | os.PathLike[str]):
        self.path = Path(directory)
        with self.guarded("the folder itself"):
            self.path.mkdir(parents=True, exist_ok=True)
            # Permission bits say nothing to root or on read-only mounts: only writing tells.
            probe = self.path / ".probe.part"
            try:
                probe.write_bytes(b"")
            finally:
                with suppress(OSError):
                    probe.unlink()
        for name in _FOLDERS:  # now, not when all has been computed
            if os.path.lexists(self.path / name) and not (self.path / name).is_dir():
                raise InputError(Problem(DIRECTORY_KEY, f"{self.path / name} is no folder, and a run needs one of that name",
                                         "a folder that can be created and written to",
                                         f"rename {name}, or choose another folder with --output"))

    def __repr__(self) -> str:
        return f"ResultsFolder({str(self.path)!r})"

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @contextmanager
    def guarded(self, what: str) -> Iterator[None]:
        """Turns any OSError of the block into an InputError that names ``what`` was being written."""
        try:
            yield
        except OSError as error:
            raise InputError(_problem(self.path, what, error)) from error

    @contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Atomic writing: yields a temporary path that becomes ``name`` when the block succeeds.

        On any failure, an interrupt included, the temporary file is removed and what stood
        under ``name`` before stays.
        """
        target = self.path / name
        temporary = target.with_name(f".{target.name}.part")
        with self.guarded(name):
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                yield temporary
                os.replace(temporary, target)
            finally:
                with suppress(OSError):
                    temporary.unlink()

    def write(self, name: str, content: bytes | str) -> Path:
        """Writes ``content`` under ``name`` in one atomic go and returns its path."""
        with self.replacing(name) as temporary:
            temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        return self.path / name

    def remove(self, *patterns: str) -> None:
        """Removes the files that match the shell patterns; those that are missing are no error."""
        for pattern in patterns:
            for path in self.path.glob(pattern):
                with self.guarded(path.name):
                    path.unlink(missing_ok=True)

    def clear(self) -> None:
        """Removes what an earlier run left here, and nothing else: call it before a fresh run."""
        self.remove(*_PRODUCTS)


def _problem(directory: Path, what: str, error: OSError) -> Problem:
    free = free_bytes(directory)
    # Some writers (numpy's tofile, Pillow) lose the error number: then only the free space tells.
    if error.errno in _FULL or (error.errno is None and free is not None and free < 1 << 20):
        left = "" if free is None else f", {_readable(free)} free"
        over = "disk quota exceeded" if error.errno == errno.EDQUOT else "disk full"
        return Problem(DIRECTORY_KEY, f"{over} while writing {what} in {directory}{left}",
                       "room for the results",
                       "free some space (--resume computes nothing again that has been computed), choose another "
                       "folder with --output, or set output.fields: false")
    return Problem(DIRECTORY_KEY, f"cannot write {what} in {directory}: {error.strerror or error}",
                   "a folder that can be created and written to",
                   "check the path and its permissions, or choose another folder with --output")


def free_bytes(directory: Path) -> int | None:
    """Free space of the disk that holds ``directory`` or its nearest existing parent; None if unknown."""
    for folder in (directory, *directory.absolute().parents):
        with suppress(OSError):
            return shutil.disk_usage(folder).free
    return None


def _readable(size: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
