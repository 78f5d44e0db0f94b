"""Closes pools that would outlive their program: at its normal end and on SIGTERM."""

from __future__ import annotations

import atexit
import os
import signal
import threading
from typing import Protocol

_watched: list["Killable"] = []


class Killable(Protocol):
    def kill(self) -> None: ...
    def close(self) -> None: ...


def watch(pool: Killable) -> None:
    """Close the pool when the program ends. A handler of SIGTERM that the program set itself is respected."""
    _watched.append(pool)
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminated)


def forget(pool: Killable) -> None:
    """The pool is closed."""
    if pool in _watched:
        _watched.remove(pool)
    if (
        not _watched
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGTERM) is _terminated
    ):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _terminated(signum, frame) -> None:
    for pool in list(_watched):
        pool.kill()
    # end the way the sender expects
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGTERM)


@atexit.register
def _at_exit() -> None:
    for pool in list(_watched):
        pool.close()
