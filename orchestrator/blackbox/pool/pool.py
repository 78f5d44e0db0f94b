"""The pool: places models on the workers of their codes, keeps all of them busy, and ends them all when one fails."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator import folders, processes
from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.diagnosis import AGREE, ROUGH, difference
from orchestrator.blackbox.pool.crew import Crew, Task, default_workers
from orchestrator.blackbox.pool.sharing import Sharing, gathered, longest_first
from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.worker import Ended, Worker
from orchestrator.blackbox.usage import Usage
from orchestrator.cost import predicted_cost
from orchestrator.errors import BlackBoxError


class Pool:
    """The black box of ``protocol.BlackBox``: models go to the workers of the code that is to solve them, all work at once.

    Parameters
    ----------
    codes : ``Model.code`` → what to run, with its settings: how many processes at once, by which transport

    Raises
    ------
    InputError, BlackBoxError : processes do not start; none is left then
    """

    def __init__(self, codes: Mapping[int, Code]):
        self._codes, self._models = dict(codes), []
        self._sharing: dict[int, Sharing] = {}  # where the models of each code are
        self._broken, self._closed = "", False
        self._folder = folders.make()
        processes.watch(self)
        self._teams: dict[int, range] = {}  # the workers of each code
        makers: list[partial[Worker]] = []
        for number, code in self._codes.items():
            own, wanted = self._folder / f"code-{number}", code.settings.workers
            self._teams[number] = range(len(makers), len(makers) + (default_workers() if wanted == "auto" else wanted))
            makers += [partial(code.worker(), code, own, worker) for worker in self._teams[number]]
        self._crew = Crew(makers)
        self._usage = Usage(self._crew, self._codes, self._teams, self._folder)
        with self._ending():
            for number, code in self._codes.items():
                (own := self._folder / f"code-{number}").mkdir()
                for name, text in code.files().items():
                    (own / name).write_text(text, encoding="utf-8")
            self._crew.start()

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says.

        Raises BlackBoxError, among others for a model that can still move freely; InputError when
        the disk is full.
        """
        if self._models:
            self._crew.stop()
            with self._ending():
                self._crew.start()
        # Longest first to whoever is free would balance the factorisations alone: on 100 grains the busier of two
        # workers then has 4 % more back-substitutions than the mean, instead of 0.1 %. They stay where the factor is.
        dofs = [int((~model.fixed).sum()) for model in models]
        costs = dict(enumerate(predicted_cost(dofs).tolist()))
        tasks = self._placed(models, costs)
        self._models = list(models)
        seconds = self._load(tasks)
        self._sharing = {code: Sharing({worker: tasks[worker] for worker in team}, costs, seconds) for code, team in self._teams.items()}
        self._usage.hold(self._sharing.values(), dofs)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        wanted = {i: _rows(i, f, len(self._models[i].trace)) for i, f in forces.items()}
        answers, busy = self._solve(messages.TRACES, wanted)
        for code in {self._models[i].code for i, f in wanted.items() if f.size}:
            self._sharing[code].answered(busy)
            self._balance(code, wanted, answers)
        return answers

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        # an eliminated dof answers its right-hand side, not zero
        fixed = {i: self._models[i].fixed.ravel() for i in forces}
        answers, _ = self._solve(messages.FIELDS, {i: np.where(fixed[i], 0.0, _rows(i, f, len(fixed[i]))) for i, f in forces.items()})
        for i, u in answers.items():
            u[:, fixed[i]] = 0.0
        return answers

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """As the protocol says."""
        return self._asked_about(models, lambda worker, own: worker.all_stiffness(own))

    def own_loads(self, models: Sequence[Model], steps: int) -> list[np.ndarray]:
        """(steps, 3n) nodal forces of each model that are the code's own, see ``CodeSettings.brings_loads``."""
        return self._asked_about(models, lambda worker, own: worker.own_loads(own, steps))

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says; a model is always asked where it was loaded first: its past is there."""
        def ask_all(worker: Worker, indices: list[int]) -> dict[int, np.ndarray]:
            return {i: worker.advance(i, forces[i], commit, self._models[i].name) for i in indices}

        return _united(self._run(ask_all, gathered((self._holders(index)[0], index) for index in forces)))

    def traits(self, code: int = 0) -> Traits:
        """As the protocol says: what the code declares, or where it leaves that open, its process."""
        return self._crew.workers[self._teams[code][0]].traits()

    @property
    def usage(self) -> Usage:
        """As the protocol says."""
        return self._usage

    def close(self) -> None:
        """As the protocol says."""
        if self._closed:
            return
        self._closed = True
        self._crew.stop()
        folders.remove(self._folder)
        processes.forget(self)

    def kill(self) -> None:
        """End all processes at once and remove all files, without waiting for any thread."""
        self._closed = True
        self._crew.kill()
        folders.remove(self._folder)

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def _placed(self, models: Sequence[Model], costs: Mapping[int, float]) -> dict[int, list[int]]:
        """Worker → the models that it is to have."""
        tasks = {}
        for code, team in self._teams.items():
            own = [i for i, model in enumerate(models) if model.code == code]
            for worker, chosen in zip(team, longest_first([costs[i] for i in own], len(team))):
                tasks[worker] = [own[place] for place in chosen]
        return tasks

    def _holders(self, index: int) -> list[int]:
        return self._sharing[self._models[index].code].holders[index]

    def _run(self, work: Any, tasks: Mapping[int, Sequence[int]], idle: bool = False) -> list:
        """Results of ``work(worker, models)`` at once for each worker that has a task; the first failure ends the pool and is raised."""
        if self._closed:
            raise BlackBoxError(self._broken or "the black box is closed")
        asked: list[Task] = [(number, work, some) for number, some in tasks.items() if some or idle]
        with self._ending():
            return self._crew.run(asked)

    def _load(self, tasks: Mapping[int, Sequence[int]]) -> dict[int, float]:
        """Have the workers load models; the seconds of each."""
        def load_all(worker: Worker, indices: Sequence[int]) -> dict[int, float]:
            begin = time.perf_counter()
            worker.load_all({index: self._models[index] for index in indices})
            return {worker.number: time.perf_counter() - begin}

        return _united(self._run(load_all, tasks))

    def _asked_about(self, models: Sequence[Model], ask: Any) -> list:
        """Answers about models that are not kept; numbers of their own overwrite no mesh file of a loaded one."""
        first, costs = len(self._models), {i: len(model.cells) for i, model in enumerate(models)}
        found = _united(self._run(lambda worker, own: ask(worker, {first + i: models[i] for i in own}), self._placed(models, costs)))
        return [found[first + i] for i in range(len(models))]

    def _solve(self, op: int, forces: Mapping[int, np.ndarray]) -> tuple[dict[int, np.ndarray], dict[int, float]]:
        """Displacements of each model, and the seconds of each worker."""
        alone, queues = {}, {}
        for code, own in gathered((self._models[i].code, i) for i, f in forces.items() if f.size).items():
            tasks, queue = self._sharing[code].tasks(own)
            alone |= tasks
            queues |= dict.fromkeys(tasks, queue)

        def solve_all(worker: Worker, some: list[int]) -> tuple[dict[int, np.ndarray], dict[int, float]]:
            begin, found = time.perf_counter(), {}
            some = some or queues[worker.number].take(worker.number)
            while some:
                found |= worker.solve(op, [(i, forces[i]) for i in some], [self._models[i].name for i in some])
                some = queues[worker.number].take(worker.number)
            return found, {worker.number: time.perf_counter() - begin}

        results = self._run(solve_all, alone, idle=True)
        answers = _united(found for found, _ in results)
        return {i: answers[i] if f.size else f.copy() for i, f in forces.items()}, _united(busy for _, busy in results)

    def _balance(self, code: int, forces: Mapping[int, np.ndarray], answers: Mapping[int, np.ndarray]) -> None:
        """Have models of a slow worker loaded by others too, where that pays.

        They are asked what has just been answered. A code that does not repeat itself to rounding keeps its models where
        they are: results would depend on who was quicker.

        Raises
        ------
        BlackBoxError : a worker answers quite otherwise than the one that had the model first
        """
        sharing = self._sharing[code]
        moves = [(index, worker) for index, worker in sharing.moves() if index in answers]
        if not moves or not self.traits(code).keeps_models:
            return
        tasks = gathered((worker, index) for index, worker in moves)
        self._load(tasks)

        def ask_again(worker: Worker, indices: list[int]) -> float:
            found = worker.solve(messages.TRACES, [(i, forces[i]) for i in indices], [self._models[i].name for i in indices])
            apart = {i: difference(u, answers[i]) for i, u in found.items()}
            worst = max(apart, key=apart.get)
            if apart[worst] > ROUGH:
                raise BlackBoxError("another process answers otherwise to the same load: relative difference "
                                    f"{apart[worst]:.1e}", self._models[worst].name)
            return apart[worst]

        sharing.settle(moves if max(self._run(ask_again, tasks)) <= AGREE else [])
        self._usage.hold(self._sharing.values(), [int((~model.fixed).sum()) for model in self._models])

    @contextmanager
    def _ending(self) -> Iterator[None]:
        """Whatever is raised within ends the pool."""
        try:
            yield
        except BaseException as error:
            self._broken = f"the black box has ended after a failure: {str(error) or type(error).__name__}"
            self.close()
            if isinstance(error, Ended):
                raise BlackBoxError(str(error)) from error
            raise


def _united(parts: Iterable[dict]) -> dict:
    return {key: value for part in parts for key, value in part.items()}


def _rows(index: int, forces: np.ndarray, size: int) -> np.ndarray:
    """Forces of a model as contiguous doubles (rhs, size); raises ValueError for another shape."""
    forces = np.ascontiguousarray(forces, np.float64)
    if forces.ndim != 2 or forces.shape[1] != size:
        raise ValueError(f"forces of model {index}: shape {forces.shape}, expected (rhs, {size})")
    return forces
