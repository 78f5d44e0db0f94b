"""Transport ``pipe``: one persistent process per worker, which keeps its models factorised."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.asking import Asking
from orchestrator.blackbox.transport.channel import Channel
from orchestrator.blackbox.transport.messages import BadReply, Buffers, Reply
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
        self.load_all({index: model})

    def load_all(self, models: Mapping[int, Model]) -> None:
        for index, reply in self._about_all(models, messages.load, "loading failed", messages.check_load):
            pass

    def all_stiffness(self, models: Mapping[int, Model]) -> dict[int, sp.csr_array]:
        def read(reply: Reply, index: int) -> sp.csr_array:
            return messages.check_stiffness(reply, index, models[index].fixed.size)

        return dict(self._about_all(models, messages.stiffness, "the stiffness matrix was not obtained", read))

    def _about_all(self, models: Mapping[int, Model], ask: Callable[[int, Model], Buffers], otherwise: str,
                   read: Callable[[Reply, int], Any]) -> Iterator[tuple[int, Any]]:
        """What ``read`` makes of the replies to a request about each model, by their numbers.

        A model's mesh is written while the code works on the one before, and that one's reply is read while it works on this
        one; ``otherwise`` tells a failure.
        """
        numbers, written = list(models), []

        def prepared(index: int) -> Buffers:
            model = self.code.told(models[index])
            written.append(self.write_mesh(index, model))
            return ask(index, model)

        blamed = 0  # place of whose failure it would be
        try:
            following = prepared(numbers[0]) if numbers else None
            if following is not None:
                self.channel.write(following, self.deadline())
            for place, index in enumerate(numbers):
                blamed, deadline = place, self.deadline()
                following = prepared(numbers[place + 1]) if place + 1 < len(numbers) else None
                reply = self._reply(deadline)
                written.pop(0).unlink(missing_ok=True)
                if following is not None:
                    blamed = place + 1
                    self.channel.write(following, self.deadline())
                blamed = place
                answer = read(reply, index)
                self.count(reply.seconds)
                yield index, answer
        except (Ended, BadReply) as error:
            raise self.failure(otherwise, error, models[numbers[blamed]].name) from error
        finally:
            for path in written:
                path.unlink(missing_ok=True)

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
