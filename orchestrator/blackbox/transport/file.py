"""Transport ``file``: stateless, one run of the code per request, the way a closed code is driven."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.asking import Asking
from orchestrator.blackbox.transport.messages import BadReply, Buffers, Reply
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.cost import Request
from orchestrator.blackbox.pool.stateless import StatelessWorker, Tally
from orchestrator.blackbox.pool.worker import Ended


class FileWorker(Asking, StatelessWorker):
    """Runs one process after another; each one reads a request file and writes a reply file.

    Nothing is kept between runs but the mesh files: every solve loads its model again.
    """

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._load_requests: dict[int, Buffers] = {}

    def open(self) -> None:
        """Of a code that leaves its traits open, a run without work: its first words tell."""
        if None in (self.code.translation_invariant, self.code.own_matter):
            self._converse(0, "", "it did not start", [], lambda replies, index: None)

    def load(self, index: int, model: Model) -> None:
        model = self.code.told(model)
        self.write_mesh(index, model)
        self._load_requests[index] = messages.load(index, model)
        self.tallies[index] = Tally(model.name, len(model.trace))
        # solved once for the check only: a model that is not held is found now, as with any transport
        self._converse(index, model.name, "loading failed", self._load_requests[index], self._read_load)

    def run_cases(self, op: int, index: int, forces: np.ndarray, name: str) -> tuple[np.ndarray, float]:
        solving = 0.0

        def read(replies: "_Replies", index: int) -> np.ndarray:
            nonlocal solving
            self._read_load(replies, index)
            reply = replies.next()
            self.count(reply.seconds)
            solving = float(reply.seconds[2])
            return messages.check_solve(reply, index, *forces.shape)

        request = self._load_requests[index] + messages.solve(op, [(index, forces)])
        answer, seconds = self._converse(index, name, "solving failed", request, read)
        # the same run serves load cases and unit loads
        cost = Request(seconds - solving, solving / len(forces))
        self.tallies[index].request = self.tallies[index].unit_loads = cost
        return answer, seconds

    def run_unit_loads(self, index: int, name: str) -> tuple[np.ndarray, float]:
        return self.run_cases(messages.TRACES, index, np.eye(self.tallies[index].trace_dofs), name)

    def _asked(self, index: int, name: str, request: Buffers, otherwise: str, read: Callable[[Reply], Any]) -> Any:
        def counted(replies: "_Replies", index: int) -> Any:
            reply = replies.next()
            self.count(reply.seconds)
            return read(reply)

        return self._converse(index, name, otherwise, request, counted)[0]

    def _read_load(self, replies: "_Replies", index: int) -> None:
        reply = replies.next()
        messages.check_load(reply, index)
        self.count(reply.seconds)

    def _converse(self, index: int, name: str, purpose: str, request: Buffers, read):
        """One run of the code: what ``read(replies, index)`` takes from its reply file, and its CPU seconds."""
        asked = self.write(f"request-{self.number}.bin", [*request, *messages.farewell()])
        answered = self.folder / f"reply-{self.number}.bin"
        try:
            process = self.spawn(asked.name, answered.name)
            code, seconds = self.wait_for_end(process)
            missing = self.code.missing_part(code, self.log_tail()) if not answered.exists() else None
            if missing:
                raise missing
            if code != 0:
                raise Ended("the run failed")
            replies = _Replies(answered)
            hello = replies.next()
            self.promised = messages.check_hello(hello)
            self.code.heard(hello.reals)
            self.seconds["start"] += float(hello.seconds[0])
            return read(replies, index), seconds
        except (Ended, BadReply) as error:
            raise self.failure(purpose, error, name) from error
        finally:
            asked.unlink(missing_ok=True)
            answered.unlink(missing_ok=True)


class _Replies:
    """Replies of a file, one after the other."""

    def __init__(self, path: Path):
        try:
            self._left = memoryview(path.read_bytes())
        except OSError as error:
            raise Ended("it wrote no answer") from error

    def next(self) -> Reply:
        return messages.read_reply(self._read_into)

    def _read_into(self, target: memoryview) -> None:
        if len(self._left) < len(target):
            raise Ended("its answer is incomplete")
        target[:] = self._left[: len(target)]
        self._left = self._left[len(target) :]
