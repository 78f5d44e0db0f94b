"""Ctrl-C and what means the same, also while modules are imported.

Libraries swallow exceptions that are raised while they are imported, or stay behind half made. An interrupt that comes
then is raised as soon as the import is over.
"""

from __future__ import annotations

import signal
from types import FrameType

_AGAIN = 0.02  # seconds until it is looked again whether an import is over
_heard = False
_waits = False


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handler of signals that end a run in good order: raises KeyboardInterrupt, if need be a little later."""
    global _heard, _waits
    _heard = _waits = True
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            signal.signal(signal.SIGALRM, interrupt)
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
            return
        frame = frame.f_back
    raise_waiting()


def raise_waiting() -> None:
    """Raises KeyboardInterrupt if an interrupt waits for the end of an import, and lets nothing come later."""
    global _waits
    if _waits:
        _waits = False
        signal.setitimer(signal.ITIMER_REAL, 0)
        raise KeyboardInterrupt


def heard() -> bool:
    """Whether there has been an interrupt."""
    return _heard
