"""Folders for the files exchanged with the code, and their removal whatever happens.

A folder carries its owner's process id in its name. What a killed owner left is swept by whoever
starts next.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from orchestrator.errors import InputError, Problem

_PREFIX = "orchestrator-"


def make() -> Path:
    """A new folder under the temporary folder (TMPDIR); raises InputError when it cannot be."""
    sweep()
    try:
        return Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-"))
    except OSError as error:
        raise InputError(Problem(
            (), f"no folder can be made in {tempfile.gettempdir()}: {error.strerror}",
            "a writable temporary folder with room", "free some room, or set TMPDIR to another folder",
        )) from error


def sweep() -> None:
    """Remove the folders of owners that are no more; those of other users stay."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}[0-9]*-*"):
        owner = path.name[len(_PREFIX) :].split("-")[0]
        try:
            if owner.isdigit() and path.stat().st_uid == os.getuid() and not _alive(int(owner)):
                shutil.rmtree(path, ignore_errors=True)
        except OSError:
            pass  # swept by someone else meanwhile


def remove(path: Path) -> None:
    """Remove a folder and all in it; may be called twice."""
    for _ in range(3):  # a thread may just be writing into it
        shutil.rmtree(path, ignore_errors=True)
        if not path.exists():
            return


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True
