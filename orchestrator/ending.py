"""The end of a command: its exit code, errors shown rather than traced, signals and lost streams in
good order.

Ctrl-C and what means the same end a run also while modules are imported: libraries swallow
exceptions that are raised then, or stay behind half made. Such an interrupt is raised as soon as
the import is over.
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType

from orchestrator.errors import (BLACKBOX_FAILED, INTERRUPTED, InputError, InternalError,
                                 OrchestratorError, lacks_memory, visible)

_AGAIN = 0.02  # seconds until it is looked again whether an import is over
_heard = False
_waits = False


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handler of signals that end a run in good order: raises KeyboardInterrupt, if need be a
    little later.
    """
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
    """Raises KeyboardInterrupt if an interrupt waits for the end of an import, and lets nothing
    come later.
    """
    global _waits
    if _waits:
        _waits = False
        signal.setitimer(signal.ITIMER_REAL, 0)
        raise KeyboardInterrupt


def guarded(action: Callable[[], int]) -> None:
    """Runs a command and ends the program with its exit code; errors of the user's are shown, not
    traced, and what an interrupt says.

    SIGTERM, SIGHUP and SIGUSR2 interrupt like Ctrl-C, so that batch systems and lost terminals get
    the checkpoint too; what is ignored, as SIGHUP is under nohup, stays so.
    """
    in_main = threading.current_thread() is threading.main_thread()
    # SIGUSR2 is what launchers of parallel runs forward to all ranks, and what batch systems can be
    # told to send
    asked = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR2
    ends = [number for number in asked if signal.getsignal(number) != signal.SIG_IGN]
    previous = {number: signal.signal(number, interrupt) for number in ends} if in_main else {}
    try:
        raise_waiting()
        try:
            code = action()
        except OrchestratorError as error:
            _show(error)
            code = error.exit_code
        except Exception as error:
            if not lacks_memory(error):
                raise
            _show(InternalError(f"{type(error).__name__}: {error}".rstrip(": "), "none is kept",
                                saved=False, memory=True))
            code = BLACKBOX_FAILED
        raise_waiting()  # a short command may end, or fail, before it has been looked again
    except KeyboardInterrupt as interrupted:
        print(" ".join(["Interrupted.", *map(str, interrupted.args)]), file=sys.stderr)
        code = INTERRUPTED
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    sys.exit(code)


def _show(error: OrchestratorError) -> None:
    """An error on stderr: a count, then one paragraph per problem, unwrapped so that paths stay
    whole.
    """
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    if isinstance(error, InputError):
        count = len(error.problems)
        console.print(Text(f"{count} problem{'s' if count > 1 else ''} in the input",
                           style="bold red"))
        for problem in error.problems:
            head, _, rest = visible(str(problem)).partition("\n")
            console.print(Text.assemble("\n", (head, "bold"), "\n", rest))
    else:
        console.print(Text.assemble(("Error: ", "bold red"), visible(str(error))))


def whole(program: Callable[[], object]) -> None:
    """Runs a program to its end: what it has to say is lost rather than what it computes, and
    interrupts end it with 130.
    """
    guard_streams()
    # what is left goes with the process: to look through it first takes a quarter of a second
    atexit.register(gc.freeze)
    code = None
    try:
        program()
    except SystemExit as ended:
        code = ended.code
    if code == 1 and _heard:  # before a command has begun, typer takes interrupts for failures
        code = INTERRUPTED
    # who has read enough, as head, closes the pipe
    if (error := lost_output()) and error.errno != errno.EPIPE:
        print(
            f"Standard output could not be written to: {error.strerror}. What was printed is "
            "lost, files are not.", file=sys.stderr)
    sys.exit(code)


class _Lenient(io.RawIOBase):
    """Writes to a file descriptor for as long as that goes; afterwards to nowhere, and remembers
    why.
    """

    def __init__(self, stream: io.TextIOWrapper):
        self._stream, self._number, self.error = stream, stream.fileno(), None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def isatty(self) -> bool:
        return os.isatty(self._number)

    def write(self, data: memoryview) -> int:
        if self.error is None:
            try:
                return os.write(self._number, data)
            except OSError as error:
                self.error = error
        return len(data)


def guard_streams() -> None:
    """Makes ``sys.stdout`` and ``sys.stderr`` such that writing to them never fails.

    Descriptors that are closed are opened on nothing first: a file of the results, or a pipe to a
    code, would get their numbers otherwise, and what others print would go there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
            os.set_inheritable(opened, True)
    sys.stdout, sys.stderr = _guarded(sys.stdout, 1), _guarded(sys.stderr, 2)


def lost_output() -> OSError | None:
    """Why standard output could not be written to, if so."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        pass
    return getattr(getattr(getattr(sys.stdout, "buffer", None), "raw", None), "error", None)


def _guarded(stream: io.TextIOWrapper | None, number: int) -> io.TextIOWrapper:
    if stream is None:  # it was closed when Python started
        stream = open(number, "w", encoding="utf-8", closefd=False)
    # Signs that the stream's alphabet lacks are written as \u2192: a name that cannot be read is
    # better than none.
    return io.TextIOWrapper(io.BufferedWriter(_Lenient(stream)), encoding=stream.encoding,
                            errors="backslashreplace",
                            line_buffering=stream.line_buffering or number == 2,
                            write_through=False)
