"""Standard output and error that end no run: closed, full, broken or of another alphabet, the results matter more."""

from __future__ import annotations

import io
import os
import sys


class _Lenient(io.RawIOBase):
    """Writes to a file descriptor for as long as that goes; afterwards to nowhere, and remembers why."""

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

    Descriptors that are closed are opened on nothing first: a file of the results, or a pipe to a code, would get their
    numbers otherwise, and what others print would go there.
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
    # Signs that the stream's alphabet lacks are written as \u2192: a name that cannot be read is better than none.
    return io.TextIOWrapper(io.BufferedWriter(_Lenient(stream)), encoding=stream.encoding, errors="backslashreplace",
                            line_buffering=stream.line_buffering or number == 2, write_through=False)
