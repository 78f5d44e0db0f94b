"""Programs that are started and waited for, one call each: whatever happens, nothing of them is left running."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

_running: set[subprocess.Popen] = set()
_starting = threading.RLock()  # so that whoever ends all meets one that has just begun; a signal may interrupt its holder


def waited_for(command: Sequence[str], patience: float, **options: Any) -> int:
    """Starts a program and waits for its end: its exit code, or minus the signal that has ended it.

    Parameters
    ----------
    command : program and arguments
    patience : seconds; options : as of ``subprocess.Popen``

    Raises
    ------
    OSError : it cannot be started
    subprocess.TimeoutExpired : it was ended after ``patience``
    """
    if setpriv := shutil.which("setpriv"):  # ends with this program, however that ends
        command = [setpriv, "--pdeathsig", "KILL", *command]
    with _starting:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, process_group=0, **options)
        _running.add(process)
    try:
        return process.wait(patience)
    finally:
        _end(process)
        process.wait()
        _running.discard(process)


def end_all() -> None:
    """End all that run now; from any thread."""
    with _starting:
        for process in list(_running):
            _end(process)


def _end(process: subprocess.Popen) -> None:
    """The whole group: a script may have started others."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
