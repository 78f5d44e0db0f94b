"""How bytes go to a code's processes and come back: through pipes or through files.

- ``Pipes``: one process, which stays and keeps its models factorised, at the other end of two anonymous pipes. A pipe ends when
  the process does, so neither side can wait for a dead one; the deadline is for a process that lives and does not answer.
- ``Files``: a process for every request, which reads one file, writes another and ends, the way a closed code is driven.
"""

from __future__ import annotations

import fcntl
import os
import select
from contextlib import suppress

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import Buffers, Reply
from orchestrator.blackbox.transport.worker import Ended, Silence, Worker, ready

_PIPE_SIZE = 1 << 20  # bytes the kernel keeps on the way; its default is 64 kB


class Pipes:
    """The orchestrator's ends of two pipes to a process that a worker has started."""

    def __init__(self, worker: Worker):
        self._worker = worker
        read_requests, self._out = os.pipe()
        self._in, write_replies = os.pipe()
        for fd in (self._in, self._out):
            os.set_blocking(fd, False)
            with suppress(OSError):  # beyond this user's allowance: only slower
                fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        try:
            worker.spawn(f"/dev/fd/{read_requests}", f"/dev/fd/{write_replies}", (read_requests, write_replies))
        except BaseException:
            self.close()
            raise
        finally:  # only then does the process's death end the pipe
            os.close(read_requests)
            os.close(write_replies)

    def send(self, buffers: Buffers) -> None:
        """Send all bytes; raises Ended."""
        deadline = self._worker.deadline()
        views = [memoryview(part).cast("B") for part in buffers if memoryview(part).nbytes]
        while views:
            try:
                sent = os.writev(self._out, views[:64])
            except BlockingIOError:
                _wait(self._out, select.POLLOUT, deadline)
                continue
            except BrokenPipeError:
                raise Ended("it ended before it was asked") from None
            while views and sent >= len(views[0]):
                sent -= len(views.pop(0))
            if sent:
                views[0] = views[0][sent:]

    def receive(self) -> Reply:
        """The next reply; raises Ended, BadReply."""
        deadline = self._worker.deadline()
        return messages.read_reply(lambda target: self._read_into(target, deadline))

    def close(self) -> None:
        """May be called twice."""
        for fd in (self._in, self._out):
            if fd >= 0:
                os.close(fd)
        self._in = self._out = -1

    def _read_into(self, target: memoryview, deadline: float) -> None:
        while target:
            try:
                received = os.readv(self._in, [target])
            except BlockingIOError:
                _wait(self._in, select.POLLIN, deadline)
                continue
            if received == 0:
                raise Ended("it ended before its answer was complete")
            target = target[received:]


class Files:
    """A run of the code for each request.

    worker : starts the processes; its ``greeted`` takes in their first words
    seconds : of CPU that the last run took
    """

    def __init__(self, worker: Worker):
        self._worker, self.seconds = worker, 0.0
        self._left = memoryview(b"")

    def send(self, buffers: Buffers) -> None:
        """Run the code on a file of these requests, to its end; raises Ended, BadReply, InputError."""
        worker = self._worker
        asked = worker.write(f"request-{worker.number}.bin", [*buffers, *messages.farewell()])
        answered = worker.folder / f"reply-{worker.number}.bin"
        try:
            code, self.seconds = worker.wait_for_end(worker.spawn(asked.name, answered.name))
            self._left = memoryview(answered.read_bytes() if answered.exists() else b"")
        finally:
            asked.unlink(missing_ok=True)
            answered.unlink(missing_ok=True)
        worker.greeted(self.receive, code)
        if code != 0:
            raise Ended("the run failed")

    def receive(self) -> Reply:
        """The next reply of the last run; raises Ended, BadReply."""
        return messages.read_reply(self._read_into)

    def close(self) -> None:
        """Nothing is open."""

    def _read_into(self, target: memoryview) -> None:
        if len(self._left) < len(target):
            raise Ended("its answer is incomplete" if len(self._left) else "it wrote no complete answer")
        target[:] = self._left[: len(target)]
        self._left = self._left[len(target) :]


def _wait(fd: int, event: int, deadline: float) -> None:
    if not ready(fd, event, deadline):
        raise Silence()
