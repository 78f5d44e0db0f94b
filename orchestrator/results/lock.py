"""One run at a time in a results folder."""

from __future__ import annotations

import fcntl
import json
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from orchestrator.errors import InputError, Problem
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.results.manifest import OWN

NAME = f"{OWN}/lock"


@contextmanager
def locked(folder: ResultsFolder) -> Iterator[None]:
    """Holds the folder's lock: the system gives it back however the run ends, so that no lock is ever stale.

    Raises
    ------
    InputError : another run holds it; the message names that run
    """
    path = folder / NAME
    while True:
        with folder.guarded(NAME):
            path.parent.mkdir(exist_ok=True)
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = _holder(file)
            os.close(file)
            raise InputError(Problem(
                DIRECTORY_KEY, f"another run writes to {folder.path}: {holder}", "a folder of its own for every run",
                "wait for that run, end it, or choose another folder with --output")) from None
        except OSError:  # a file system without locks
            os.close(file)
            yield
            return
        with suppress(OSError):
            if os.fstat(file).st_ino == os.stat(path).st_ino:  # else the one before has just removed it
                break
        os.close(file)
    try:
        about = {"pid": os.getpid(), "host": platform.node(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        with suppress(OSError):  # a full disk still locks
            os.ftruncate(file, 0)
            os.pwrite(file, json.dumps(about).encode(), 0)
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(file)


def _holder(file: int) -> str:
    try:
        about = json.loads(os.pread(file, 1000, 0))
        return f"process {about['pid']} on {about['host']}, since {about['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "a process that has just begun"
