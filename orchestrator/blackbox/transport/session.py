"""Talks the bytes of ``messages`` with processes of a code, in one of two ways.

- ``pipe``: one process, which stays and keeps its models factorised, at the other end of two anonymous pipes. A pipe ends when
  the process does, so neither side can wait for a dead one; the deadline is for a process that lives and does not answer.
- ``file``: a process for every request, which reads one file, writes another and ends, the way a closed code is driven. Nothing
  is kept between runs but the mesh files: every solve loads its model again.
"""

from __future__ import annotations

import fcntl
import os
import select
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.cost import Request
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply, Buffers, Reply
from orchestrator.blackbox.transport.runs import RunWorker, Tally
from orchestrator.blackbox.transport.worker import Ended, Silence, Worker, ready

_PIPE_SIZE = 1 << 20  # bytes the kernel keeps on the way; its default is 64 kB


class Pipes:
    """The orchestrator's ends of two pipes to a process that a worker has started."""

    def __init__(self, worker: Worker):
        self._worker = worker
        read_requests, self._out = os.pipe()
        self._in, write_replies = os.pipe()
        self._buffer = bytearray(_PIPE_SIZE)
        self._start = self._stop = 0
        for fd in (self._in, self._out):
            os.set_blocking(fd, False)
            try:
                fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
            except (OSError, AttributeError):
                pass  # beyond this user's allowance: only slower
        try:
            worker.spawn(f"/dev/fd/{read_requests}", f"/dev/fd/{write_replies}", (read_requests, write_replies))
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
        at = min(len(target), self._stop - self._start)
        target[:at] = memoryview(self._buffer)[self._start : self._start + at]
        self._start += at
        while at < len(target):  # nothing is kept: what the target has room for goes there at once
            try:
                received = os.readv(self._in, [target[at:], self._buffer])
            except BlockingIOError:
                _wait(self._in, select.POLLIN, deadline)
                continue
            if received == 0:
                raise Ended("it ended before its answer was complete")
            here = min(received, len(target) - at)
            at, self._start, self._stop = at + here, 0, received - here


class Files:
    """A run of the code for each request.

    Attributes
    ----------
    seconds : of CPU that the last run took
    """

    def __init__(self, worker: MessageWorker):
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


class MessageWorker(RunWorker):
    """A worker of a ``MessageCode``; how it talks to its processes is a setting of the code."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.keeps_models = self.code.settings.transport == "pipe"
        self.link: Pipes | Files | None = None
        self._load_requests: dict[int, Buffers] = {}

    def open(self) -> None:
        """Start the process, or of a code that leaves its traits open one without work: its first words tell."""
        if self.keeps_models:
            self.link = Pipes(self)
            with self.telling("it did not start", ""):
                self.greeted(self.link.receive)
            return
        self.link = Files(self)
        if None in (self.code.translation_invariant, self.code.own_matter):
            with self.telling("it did not start", ""):
                self.link.send([])

    def greeted(self, receive: Callable[[], Reply], exit_code: int | None = None) -> None:
        """Take in a process's first words; raises InputError where there are none because something is not installed."""
        try:
            hello = receive()
            self.promised = messages.check_hello(hello)
        except (Ended, BadReply) as error:
            failure = self.failure("it did not start", error, "")  # waits for the process's end
            missing = self.code.missing_part(self.process.returncode if exit_code is None else exit_code, self.log_tail())
            raise missing or (failure if exit_code is None else error) from error
        self.code.heard(hello.reals)
        self.seconds["start"] += float(hello.seconds[0])

    def load_all(self, models: Mapping[int, Model]) -> None:
        """As ``Worker`` says; what ends after a run is solved once for the check: a model that is not held is found now."""
        for index, model in models.items():
            self.tallies[index] = Tally(model.name, len(model.trace))
        for _ in self._about(models, messages.load, "loading failed", messages.check_load, kept=not self.keeps_models):
            pass

    def all_stiffness(self, models: Mapping[int, Model]) -> dict[int, sp.csr_array]:
        """As ``Worker`` says."""
        return dict(self._about(models, messages.stiffness, "the stiffness matrix was not obtained",
                                lambda reply, index: messages.check_stiffness(reply, index, models[index].fixed.size)))

    def own_loads(self, models: Mapping[int, Model], steps: int) -> dict[int, np.ndarray]:
        """As ``Worker`` says."""
        return dict(self._about(models, lambda index, model: messages.own_loads(index, model, steps), "its own loads were not obtained",
                                lambda reply, index: messages.check_own_loads(reply, index, steps, models[index].fixed.size)))

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]], names: list[str]) -> dict[int, np.ndarray]:
        """As ``Worker`` says: through pipes all right-hand sides of all models travel in one message."""
        if not self.keeps_models:
            return super().solve(op, jobs, names)
        answers: dict[int, np.ndarray] = {}
        with self.telling("solving failed", names[0]):
            self.link.send(messages.solve(op, jobs))
        for (index, forces), name in zip(jobs, names):
            with self.telling("solving failed", name):
                answers[index] = self._counted(lambda reply: messages.check_solve(reply, index, *forces.shape))
        return answers

    def run_cases(self, op: int, index: int, forces: np.ndarray, name: str) -> tuple[np.ndarray, float]:
        """As ``RunWorker`` says; the same run serves load cases and unit loads."""
        with self.telling("solving failed", name):
            self.link.send(self._load_requests[index] + messages.solve(op, [(index, forces)]))
            self._counted(lambda reply: messages.check_load(reply, index))
            before = self.seconds["solve"]
            answer = self._counted(lambda reply: messages.check_solve(reply, index, *forces.shape))
        solving, tally = self.seconds["solve"] - before, self.tallies[index]
        tally.request = tally.unit_loads = Request(self.link.seconds - solving, solving / len(forces))
        return answer, self.link.seconds

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        """As ``Worker`` says."""
        with self.telling("a load step was not solved", name):
            self.link.send(messages.advance(index, forces, commit))
            return self._counted(lambda reply: messages.check_solve(reply, index, 2, forces.size))

    def release(self) -> None:
        """As ``Worker`` says."""
        super().release()
        if self.link is not None:
            self.link.close()

    def _counted(self, read: Callable[[Reply], Any]) -> Any:
        reply = self.link.receive()
        answer = read(reply)
        self.count(reply.seconds)
        return answer

    def _about(self, models: Mapping[int, Model], ask: Callable[[int, Model], Buffers], purpose: str,
               read: Callable[[Reply, int], Any], kept: bool = False) -> Iterator[tuple[int, Any]]:
        """What ``read`` makes of the replies to a request about each model, by their numbers.

        A model's mesh is written while the code works on the one before, and that one's reply is read while it works on this
        one. Mesh files, and requests, are ``kept`` for runs to come.
        """
        paths, before = {}, None
        try:
            for index in [*models, None]:
                if index is not None:
                    model = self.code.told(models[index])
                    paths[index] = self.write(f"mesh-{index}.{self.code.mesh_suffix}", [self.code.mesh(model)])
                    request = ask(index, model)
                    if kept:
                        self._load_requests[index] = request
                if before is not None:
                    with self.telling(purpose, models[before].name):
                        reply = self.link.receive()
                    if not kept:
                        paths.pop(before).unlink(missing_ok=True)
                if index is not None:
                    with self.telling(purpose, models[index].name):
                        self.link.send(request)
                if before is not None:
                    with self.telling(purpose, models[before].name):
                        answer = read(reply, before)
                    self.count(reply.seconds)
                    yield before, answer
                before = index
        finally:
            for path in () if kept else paths.values():
                path.unlink(missing_ok=True)


def _wait(fd: int, event: int, deadline: float) -> None:
    if not ready(fd, event, deadline):
        raise Silence()
