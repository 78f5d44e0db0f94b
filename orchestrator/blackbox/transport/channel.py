"""Two anonymous pipes to a process, with a deadline on every byte.

A pipe ends when the process at its other end does, so neither side can wait for a dead one; the
deadline is for a process that lives but does not answer.
"""

from __future__ import annotations

import fcntl
import os
import select
import time
from collections.abc import Callable

from orchestrator.blackbox.pool.worker import Ended, Silence

_PIPE_SIZE = 1 << 20  # bytes the kernel keeps on the way; its default is 64 kB
_F_SETPIPE_SZ = 1031


class Channel:
    """The orchestrator's ends of both pipes; ``child_fds`` (to read, to write) are the process's."""

    def __init__(self) -> None:
        read_requests, self._out = os.pipe()
        self._in, write_replies = os.pipe()
        self.child_fds = (read_requests, write_replies)
        self._buffer = bytearray(_PIPE_SIZE)
        self._start = self._stop = 0
        self.hopeless: Callable[[], str] = str  # asked while waiting: why no answer will come, if that is so
        for fd in (self._in, self._out):
            os.set_blocking(fd, False)
            try:
                fcntl.fcntl(fd, _F_SETPIPE_SZ, _PIPE_SIZE)
            except OSError:
                pass  # beyond this user's allowance: only slower

    def hand_over(self) -> None:
        """Close the process's ends on this side once it has them: only then does its death end the pipe."""
        for fd in self.child_fds:
            os.close(fd)
        self.child_fds = ()

    def close(self) -> None:
        """May be called twice."""
        self.hand_over()
        for fd in (self._in, self._out):
            if fd >= 0:
                os.close(fd)
        self._in = self._out = -1

    def write(self, buffers: list, deadline: float) -> None:
        """Send all bytes; raises Ended."""
        views = [memoryview(part).cast("B") for part in buffers if memoryview(part).nbytes]
        while views:
            try:
                sent = os.writev(self._out, views[:64])
            except BlockingIOError:
                self._wait(self._out, select.POLLOUT, deadline)
                continue
            except BrokenPipeError:
                raise Ended("it ended before it was asked") from None
            while views and sent >= len(views[0]):
                sent -= len(views.pop(0))
            if sent:
                views[0] = views[0][sent:]

    def read_into(self, target: memoryview, deadline: float) -> None:
        """Fill ``target`` (bytes); raises Ended."""
        at = min(len(target), self._stop - self._start)
        target[:at] = memoryview(self._buffer)[self._start : self._start + at]
        self._start += at
        while at < len(target):  # nothing is kept: what the target has room for goes there at once
            received = self._receive([target[at:], self._buffer], deadline)
            here = min(received, len(target) - at)
            at, self._start, self._stop = at + here, 0, received - here

    def _receive(self, buffers: list, deadline: float) -> int:
        while True:
            try:
                received = os.readv(self._in, buffers)
            except BlockingIOError:
                self._wait(self._in, select.POLLIN, deadline)
                continue
            if received == 0:
                raise Ended("it ended before its answer was complete")
            return received

    def _wait(self, fd: int, event: int, deadline: float) -> None:
        poll = select.poll()
        poll.register(fd, event)
        while (left := deadline - time.monotonic()) > 0:
            if poll.poll(min(left, 1.0) * 1000):
                return
            if why := self.hopeless():
                raise Ended(why)
        raise Silence()
