"""Processes that tests start, and whether they have ended."""

import ctypes
import os
import signal
import subprocess
import time
from pathlib import Path

_begun: list[subprocess.Popen] = []
_LIBC, _SET_PDEATHSIG = ctypes.CDLL(None), 1


def _end_with_parent() -> None:
    """The kernel ends this process when the one that runs the tests is no more, killed though it may be."""
    _LIBC.prctl(_SET_PDEATHSIG, signal.SIGTERM)


def begin(*command: str, **options) -> subprocess.Popen:
    """A child with its stdout as text, and its stderr too unless told otherwise; it ends with the test, or with pytest."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "preexec_fn": _end_with_parent, **options}
    _begun.append(subprocess.Popen(command, **options))
    return _begun[-1]


def end_all(patience=10.0) -> None:
    """End whatever a test that failed has left running: in good order, and if that takes too long by force."""
    while _begun:
        child = _begun.pop()
        if child.poll() is not None:
            continue
        child.terminate()
        try:
            child.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            own_group = os.getpgid(child.pid) == child.pid
            os.killpg(child.pid, signal.SIGKILL) if own_group else child.kill()
            child.communicate()


def hear_signals() -> None:
    """Let children hear what ends a run, even if this process was started without: they would inherit that.

    Scripts start without SIGINT what they put in the background, nohup without SIGHUP. This process goes on as it was: it hears
    the signal and does nothing, and a handler, unlike an ignored signal, is not inherited.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR2):
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)


def running(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def gone(pids, patience=60.0) -> bool:
    """Whether all processes have ended before the seconds of patience are over."""
    end = time.monotonic() + patience
    while any(running(pid) for pid in pids):
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def working_below(folder) -> list[int]:
    """Process ids of what runs with its working directory below a folder: codes, in their black box's folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if running(int(path.name)) and str(folder) in os.readlink(path / "cwd"):
                found.append(int(path.name))
        except OSError:
            pass
    return found


def nothing_left(folder, patience=60.0) -> bool:
    """Whether no process works below a folder and no file is in it, before the seconds of patience are over."""
    end = time.monotonic() + patience
    while working_below(folder) or list(folder.iterdir()):
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
