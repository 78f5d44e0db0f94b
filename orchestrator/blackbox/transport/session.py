"""The worker of codes that speak the bytes of ``messages``: models, load cases and answers through
one of two links.

A process that stays keeps its models. Of one that ends after every request nothing is kept but the
mesh files: every solve loads its model again.

- ``Pipes``: one process, which stays and keeps its models factorised, at the other end of two
anonymous pipes. A pipe ends when
  the process does, so neither side can wait for a dead one; the deadline is for a process that
  lives and does not answer.
- ``Files``: a process for every request, which reads one file, writes another and ends, the way a
closed code is driven.
"""

from __future__ import annotations

import fcntl
import os
import select
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.messages import BadReply, Buffers, Reply
from orchestrator.blackbox.transport.runs import Request, RunWorker, Tally
from orchestrator.blackbox.transport.worker import Ended, Worker, ready
from orchestrator.processes import last_words

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
            worker.spawn(f"/dev/fd/{read_requests}", f"/dev/fd/{write_replies}",
                         (read_requests, write_replies))
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
                ready(self._out, select.POLLOUT, deadline)
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
                ready(self._in, select.POLLIN, deadline)
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
        """Run the code on a file of these requests, to its end; raises Ended, BadReply,
        InputError.
        """
        worker = self._worker
        asked = worker.write(f"request-{worker.number}.bin", [*buffers, messages.FAREWELL])
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
            raise Ended("its answer is incomplete" if len(self._left)
                        else "it wrote no complete answer")
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
        """Start the process, or of a code that leaves its traits open one without work: its first
        words tell.
        """
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
        """Take in a process's first words; raises InputError where there are none because something
        is not installed.
        """
        try:
            hello = receive()
            self.promised = messages.check_hello(hello)
        except (Ended, BadReply) as error:
            failure = self.failure("it did not start", error, "")  # waits for the process's end
            missing = self.code.missing_part(self.process.returncode if exit_code is None
                                             else exit_code, last_words(self.log))
            raise missing or (failure if exit_code is None else error) from error
        self.code.heard(hello.reals)
        self.seconds["start"] += float(hello.seconds[0])

    def load(self, index: int, model: Model) -> None:
        """Load models; a code that ends after a run solves once for the check: a model that is not
        held is found now.
        """
        self.tallies[index] = Tally(model.name, len(model.trace))
        self._about(messages.LOAD, index, model, "loading failed",
                    lambda reply: messages.check_load(reply, index))

    def stiffness(self, index: int, model: Model) -> sp.csr_array:
        return self._about(messages.STIFFNESS, index, model,
                           "the stiffness matrix was not obtained",
                           lambda reply: messages.check_stiffness(reply, index, model.fixed.size))

    def own_loads(self, index: int, model: Model, steps: int) -> np.ndarray:
        return self._about(messages.OWN_LOADS, index, model, "its own loads were not obtained",
                           lambda reply: messages.check_own_loads(
                               reply, index, steps, model.fixed.size), steps)

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]],
              names: list[str]) -> dict[int, np.ndarray]:
        """Solve: through pipes all right-hand sides of all models travel in one message."""
        if not self.keeps_models:
            return super().solve(op, jobs, names)
        answers: dict[int, np.ndarray] = {}
        with self.telling("solving failed", names[0]):
            self.link.send(messages.solve(op, jobs))
        for (index, forces), name in zip(jobs, names):
            with self.telling("solving failed", name):
                answers[index] = self._counted(
                    lambda reply: messages.check_solve(reply, index, *forces.shape))
        return answers

    def run_cases(self, op: int, index: int, forces: np.ndarray,
                  name: str) -> tuple[np.ndarray, float]:
        """Solve load cases: the same run serves load cases and unit loads."""
        with self.telling("solving failed", name):
            self.link.send(self._load_requests[index] + messages.solve(op, [(index, forces)]))
            self._counted(lambda reply: messages.check_load(reply, index))
            before = self.seconds["solve"]
            answer = self._counted(lambda reply: messages.check_solve(reply, index, *forces.shape))
        solving, tally = self.seconds["solve"] - before, self.tallies[index]
        tally.request = tally.unit_loads = Request(self.link.seconds - solving,
                                                   solving / len(forces))
        return answer, self.link.seconds

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        with self.telling("a load step was not solved", name):
            self.link.send(messages.request(messages.ADVANCE, [index, int(commit)], [forces]))
            return self._counted(lambda reply: messages.check_solve(reply, index, 2, forces.size))

    def release(self) -> None:
        super().release()
        if self.link is not None:
            self.link.close()

    def _counted(self, read: Callable[[Reply], Any]) -> Any:
        reply = self.link.receive()
        answer = read(reply)
        self.count(reply.seconds)
        return answer

    def _about(self, op: int, index: int, model: Model, purpose: str, read: Callable[[Reply], Any],
               *more: int) -> Any:
        """The reply to a request about a model, as ``read`` makes it. For runs to come, mesh file
        and request are kept.
        """
        told, kept = self.code.told(model), op == messages.LOAD and not self.keeps_models
        path, request = self.write(f"mesh-{index}.{self.code.mesh_suffix}",
                                   [self.code.mesh(told)]), messages.about(op, index, told, *more)
        if kept:
            self._load_requests[index] = request
        try:
            with self.telling(purpose, model.name):
                self.link.send(request)
                return self._counted(read)
        finally:
            if not kept:
                path.unlink(missing_ok=True)
