"""The worker of codes that speak the bytes of ``messages``: models, load cases and answers through one of two ``links``.

A process that stays keeps its models. Of one that ends after every request nothing is kept but the mesh files: every solve loads
its model again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.transport.runs import Request, RunWorker, Tally
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.links import Files, Pipes
from orchestrator.blackbox.transport.messages import BadReply, Buffers, Reply
from orchestrator.blackbox.transport.worker import Ended


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
        self._about(models, messages.load, "loading failed", messages.check_load, kept=not self.keeps_models)

    def all_stiffness(self, models: Mapping[int, Model]) -> dict[int, sp.csr_array]:
        return self._about(models, messages.stiffness, "the stiffness matrix was not obtained",
                           lambda reply, index: messages.check_stiffness(reply, index, models[index].fixed.size))

    def own_loads(self, models: Mapping[int, Model], steps: int) -> dict[int, np.ndarray]:
        return self._about(models, lambda index, model: messages.own_loads(index, model, steps), "its own loads were not obtained",
                           lambda reply, index: messages.check_own_loads(reply, index, steps, models[index].fixed.size))

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
        with self.telling("a load step was not solved", name):
            self.link.send(messages.advance(index, forces, commit))
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

    def _about(self, models: Mapping[int, Model], ask: Callable[[int, Model], Buffers], purpose: str,
               read: Callable[[Reply, int], Any], kept: bool = False) -> dict[int, Any]:
        """What ``read`` makes of the replies to a request about each model. Mesh files, and requests, are ``kept`` for runs to come."""
        answers = {}
        for index, model in models.items():
            told = self.code.told(model)
            path = self.write(f"mesh-{index}.{self.code.mesh_suffix}", [self.code.mesh(told)])
            request = ask(index, told)
            if kept:
                self._load_requests[index] = request
            try:
                with self.telling(purpose, model.name):
                    self.link.send(request)
                    answers[index] = self._counted(lambda reply: read(reply, index))
            finally:
                if not kept:
                    path.unlink(missing_ok=True)
        return answers
