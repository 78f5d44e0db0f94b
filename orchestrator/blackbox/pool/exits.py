"""Exit codes in words."""

from __future__ import annotations

import signal
from collections.abc import Mapping

_HINTS = {"SIGKILL": ", by hand or by the kernel for want of memory", "SIGSEGV": ", segmentation fault",
          "SIGABRT": ", abnormal end"}


def exit_meaning(exit_code: int, meanings: Mapping[int, str], otherwise: str = "ended with an error") -> str:
    """What an exit code says; negative codes are signals.

    Parameters
    ----------
    meanings : the code's own exit codes
    otherwise : what to say of unknown ones
    """
    if exit_code < 0:
        try:
            name = signal.Signals(-exit_code).name
        except ValueError:
            name = f"signal {-exit_code}"
        return f"{exit_code}: killed by {name}{_HINTS.get(name, '')}"
    return f"{exit_code}: {meanings.get(exit_code, 'normal end' if exit_code == 0 else otherwise)}"
