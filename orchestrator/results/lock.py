"""One run at a time in a results folder."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from orchestrator.errors import InputError, Problem
from orchestrator.results.folder import DIRECTORY_KEY, ResultsFolder
from orchestrator.results.manifest import OWN

NAME, HOLDER = f"{OWN}/lock", f"{OWN}/holder.json"


@contextmanager
def locked(folder: ResultsFolder) -> Iterator[None]:
    """Holds the folder's lock: the system gives it back however the run ends, so that no lock is ever stale.

    Raises InputError: another run holds it; the message names that run
    """
    from filelock import FileLock, Timeout

    lock, about = FileLock(folder / NAME, timeout=0), {"pid": os.getpid(), "host": platform.node(), "since": time.strftime("%F %T")}
    with folder.guarded(NAME):
        (folder / NAME).parent.mkdir(exist_ok=True)
        try:
            lock.acquire()
        except Timeout:
            raise InputError(Problem(
                DIRECTORY_KEY, f"another run writes to {folder.path}: {_holder(folder)}", "a folder of its own for every run",
                "wait for that run, end it, or choose another folder with --output")) from None
    try:
        with suppress(OSError), open(folder / HOLDER, "w", opener=_not_through_links) as file:  # a full disk still locks
            json.dump(about, file)
        yield
    finally:
        with suppress(OSError):
            (folder / HOLDER).unlink()
        lock.release()


def _not_through_links(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW, 0o644)


def _holder(folder: ResultsFolder) -> str:
    try:
        about = json.loads((folder / HOLDER).read_bytes())
        return f"process {about['pid']} on {about['host']}, since {about['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "a process that has just begun"
