"""Transport ``pipe``: one persistent process per worker, which keeps its models factorised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.asking import Asking
from orchestrator.blackbox.transport.channel import Channel
from orchestrator.blackbox.transport.messages import BadReply, Reply
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.pool.starvation import Starvation
from orchestrator.blackbox.pool.worker import Ended, Worker


class PipeWorker(Asking, Worker):
    """Hosts many models in one process; all right-hand sides of all its models travel in one message."""

    channel: Channel | None = None

    def open(self) -> None:
        self.channel = Channel()
        requests, replies = self.channel.child_fds
        process = self.spawn(f"/dev/fd/{requests}", f"/dev/fd/{replies}", self.channel.child_fds)
        self.channel.hopeless = Starvation(process.pid)
        self.channel.hand_over()
        try:
            reply = self._reply(self.deadline())
            self.promised = messages.check_hello(reply)
            self.code.heard(reply.reals)
        except (Ended, BadReply) as error:
            failure = self.failure("it did not start", error, "")
            missing = self.code.missing_part(self.process.returncode, self.log_tail())
            raise missing or failure from error
        self.seconds["start"] += float(reply.seconds[0])

    def load(self, index: int, model: Model) -> None:
        model = self.code.told(model)
        path = self.write_mesh(index, model)
        request = messages.load(index, model)
        try:
            deadline = self.deadline()
            self.channel.write(request, deadline)
            reply = self._reply(deadline)
            messages.check_load(reply, index)
        except (Ended, BadReply) as error:
            raise self.failure("loading failed", error, model.name) from error
        finally:
            path.unlink(missing_ok=True)
        self.count(reply.seconds)

    def solve(self, op: int, jobs: list[tuple[int, np.ndarray]], names: list[str]) -> dict[int, np.ndarray]:
        answers: dict[int, np.ndarray] = {}
        try:
            self.channel.write(messages.solve(op, jobs), self.deadline())
            for index, forces in jobs:
                reply = self._reply(self.deadline())
                answers[index] = messages.check_solve(reply, index, *forces.shape)
                self.count(reply.seconds)
        except (Ended, BadReply) as error:
            raise self.failure("solving failed", error, names[len(answers)]) from error
        return answers

    def advance(self, index: int, forces: np.ndarray, commit: bool, name: str) -> np.ndarray:
        return self._asked(index, name, messages.advance(index, forces, commit), "a load step was not solved",
                           lambda reply: messages.check_solve(reply, index, 2, forces.size))

    def _asked(self, index: int, name: str, request: messages.Buffers, otherwise: str, read: Callable[[Reply], Any]) -> Any:
        try:
            deadline = self.deadline()
            self.channel.write(request, deadline)
            reply = self._reply(deadline)
            answer = read(reply)
        except (Ended, BadReply) as error:
            raise self.failure(otherwise, error, name) from error
        self.count(reply.seconds)
        return answer

    def release(self) -> None:
        super().release()
        if self.channel is not None:
            self.channel.close()

    def _reply(self, deadline: float) -> Reply:
        return messages.read_reply(lambda view: self.channel.read_into(view, deadline))
