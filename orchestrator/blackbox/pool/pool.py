"""The pool: places models on workers, keeps all of them busy, and ends them all when one fails."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from typing import NoReturn

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.pool import lifetime, workdir
from orchestrator.blackbox.pool.crew import Crew, Task
from orchestrator.blackbox.pool.diagnosis import AGREE, ROUGH, difference
from orchestrator.blackbox.pool.sharing import Sharing
from orchestrator.blackbox.pool.usage import PoolUsage
from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.pool.worker import Ended, Worker
from orchestrator.blackbox.protocol import Model, Traits
from orchestrator.blackbox.transport import messages
from orchestrator.cost import predicted_cost
from orchestrator.errors import BlackBoxError


def default_workers() -> int:
    """One worker per core this process may use."""
    return max(1, len(os.sched_getaffinity(0)))


def longest_first(costs: Sequence[float], workers: int) -> list[list[int]]:
    """Tasks of every worker: each task, longest first, goes to the worker with the least to do."""
    tasks: list[list[int]] = [[] for _ in range(workers)]
    busy = np.zeros(workers)
    for index in np.argsort(-np.asarray(costs, float), kind="stable"):
        worker = int(np.argmin(busy))
        tasks[worker].append(int(index))
        busy[worker] += costs[index]
    return tasks


class Pool:
    """The black box of ``protocol.BlackBox`` over workers of any transport.

    Parameters
    ----------
    code : what to run, and its settings: how many processes at once, by which transport
    wait : until its processes are ready; else ``ready`` must be called before anything else
    """

    def __init__(self, code: Code, wait: bool = True):
        self._models: list[Model] = []
        self._sharing: Sharing | None = None  # where the models are
        self._broken, self._closed = "", False
        self._folder = workdir.make()
        lifetime.watch(self)
        for name, text in code.files().items():
            (self._folder / name).write_text(text, encoding="utf-8")
        workers, worker = code.settings.workers, code.worker()
        self._crew = Crew(lambda number: worker(code, self._folder, number),
                          default_workers() if workers == "auto" else workers)
        self._usage = PoolUsage(self._crew, code, self._folder)
        self._start(wait)

    def ready(self) -> None:
        """Wait until all processes have started."""
        try:
            self._crew.ready()
        except BaseException as error:
            self._fail(error)

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says.

        Raises BlackBoxError, among others for a model that can still move freely; InputError when
        the disk is full.
        """
        if self._sharing is not None:
            self._crew.stop()
            self._start(wait=True)
        # Longest first to whoever is free would balance the factorisations alone: on 100 grains the busier of two
        # workers then has 4 % more back-substitutions than the mean, instead of 0.1 %. They stay where the factor is.
        dofs = [int((~model.fixed).sum()) for model in models]
        costs = predicted_cost(dofs)
        tasks = longest_first(costs, self._crew.count)
        self._models = list(models)
        self._sharing = Sharing(tasks, costs, self._load(dict(enumerate(tasks))))
        self._usage.hold(self._sharing.holders, dofs)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        wanted = {i: _rows(i, f, len(self._models[i].trace)) for i, f in forces.items()}
        return self._solve(messages.TRACES, wanted)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        wanted = {}
        for i, f in forces.items():
            model = self._models[i]
            # an eliminated dof answers its right-hand side, not zero
            wanted[i] = np.where(model.fixed.ravel(), 0.0, _rows(i, f, 3 * len(model.nodes)))
        answers = self._solve(messages.FIELDS, wanted)
        for i, u in answers.items():
            u[:, self._models[i].fixed.ravel()] = 0.0
        return answers

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """As the protocol says."""
        matrices: list[sp.csr_array | None] = [None] * len(models)
        # numbers of their own, so that no mesh file of a loaded model is overwritten
        first = len(self._models)

        def assemble_all(worker: Worker, indices: list[int]) -> None:
            for number, matrix in worker.all_stiffness({first + index: models[index] for index in indices}).items():
                matrices[number - first] = matrix

        tasks = longest_first([len(model.cells) for model in models], self._crew.count)
        self._run([(w, assemble_all, indices) for w, indices in enumerate(tasks) if indices])
        return matrices

    def own_loads(self, models: Sequence[Model], steps: int) -> list[np.ndarray]:
        """(steps, 3n) nodal forces of each model that are the code's own, see ``CodeSettings.brings_loads``."""
        found: list[np.ndarray | None] = [None] * len(models)
        first = len(self._models)

        def ask_all(worker: Worker, indices: list[int]) -> None:
            for index in indices:
                found[index] = worker.own_loads(first + index, models[index], steps)

        tasks = longest_first([len(model.cells) for model in models], self._crew.count)
        self._run([(w, ask_all, indices) for w, indices in enumerate(tasks) if indices])
        return found

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says; a model is always asked where it was loaded first: its past is there."""
        answers: dict[int, np.ndarray] = {}

        def ask_all(worker: Worker, indices: list[int]) -> None:
            for index in indices:
                answers[index] = worker.advance(index, forces[index], commit, self._models[index].name)

        tasks: dict[int, list[int]] = {}
        for index in forces:
            tasks.setdefault(self._sharing.holders[index][0], []).append(index)
        self._run([(w, ask_all, indices) for w, indices in tasks.items()])
        return answers

    def traits(self, code: int = 0) -> Traits:
        """As the protocol says: what the code declares, or where it leaves that open, its process."""
        return self._crew.workers[0].traits()

    @property
    def usage(self) -> PoolUsage:
        """As the protocol says."""
        return self._usage

    def close(self) -> None:
        """As the protocol says."""
        if self._closed:
            return
        self._closed = True
        self._crew.stop()
        workdir.remove(self._folder)
        lifetime.forget(self)

    def kill(self) -> None:
        """End all processes at once and remove all files, without waiting for any thread."""
        self._closed = True
        self._crew.kill()
        workdir.remove(self._folder)

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def _start(self, wait: bool) -> None:
        try:
            self._crew.start()
        except BaseException as error:
            self._fail(error)
        if wait:
            self.ready()

    def _run(self, tasks: Sequence[Task]) -> list:
        """Run tasks at once; the first failure ends the pool and is raised."""
        if self._closed:
            raise BlackBoxError(self._broken or "the black box is closed")
        try:
            return self._crew.run(tasks)
        except BaseException as error:
            self._fail(error)

    def _fail(self, error: BaseException) -> NoReturn:
        self._broken = f"the black box has ended after a failure: {str(error) or type(error).__name__}"
        self.close()
        if isinstance(error, Ended):
            raise BlackBoxError(str(error)) from error
        raise error

    def _load(self, tasks: Mapping[int, Sequence[int]]) -> list[float]:
        """Have the workers load models; the seconds of each."""
        seconds = [0.0] * self._crew.count

        def load_all(worker: Worker, indices: Sequence[int]) -> None:
            begin = time.perf_counter()
            worker.load_all({index: self._models[index] for index in indices})
            seconds[worker.number] = time.perf_counter() - begin

        self._run([(w, load_all, indices) for w, indices in tasks.items() if indices])
        return seconds

    def _solve(self, op: int, forces: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        alone, queue = self._sharing.tasks([index for index, f in forces.items() if f.size])
        answers: dict[int, np.ndarray] = {}
        busy: dict[int, float] = {}

        def solve_all(worker: Worker, some: list[int]) -> None:
            begin = time.perf_counter()
            some = some or queue.take(worker.number)
            while some:
                answers.update(worker.solve(op, [(index, forces[index]) for index in some],
                                            [self._models[index].name for index in some]))
                some = queue.take(worker.number)
            busy[worker.number] = time.perf_counter() - begin

        self._run([(w, solve_all, some) for w, some in alone.items()])
        if op == messages.TRACES:
            self._sharing.answered(busy)
            self._balance(forces, answers)
        return {index: answers[index] if f.size else f.copy() for index, f in forces.items()}

    def _balance(self, forces: Mapping[int, np.ndarray], answers: Mapping[int, np.ndarray]) -> None:
        """Have models of a slow worker loaded by others too, where that pays.

        They are asked what has just been answered. A code that does not repeat itself to rounding keeps its models where
        they are: results would depend on who was quicker.

        Raises
        ------
        BlackBoxError : a worker answers quite otherwise than the one that had the model first
        """
        if not self._crew.workers[0].keeps_models:
            return
        moves = [(index, worker) for index, worker in self._sharing.moves() if index in answers]
        if not moves:
            return
        tasks: dict[int, list[int]] = {}
        for index, worker in moves:
            tasks.setdefault(worker, []).append(index)
        self._load(tasks)

        def ask_again(worker: Worker, indices: list[int]) -> float:
            names, largest = [self._models[index].name for index in indices], 0.0
            for index, found in worker.solve(messages.TRACES, [(i, forces[i]) for i in indices], names).items():
                largest = max(largest, apart := difference(found, answers[index]))
                if apart > ROUGH:
                    raise BlackBoxError(f"another process answers otherwise to the same load: relative difference {apart:.1e}",
                                        self._models[index].name)
            return largest

        apart = max(self._run([(w, ask_again, indices) for w, indices in tasks.items()]))
        self._sharing.settle(moves if apart <= AGREE else [])
        self._usage.hold(self._sharing.holders, [int((~model.fixed).sum()) for model in self._models])


def _rows(index: int, forces: np.ndarray, size: int) -> np.ndarray:
    """Forces of a model as contiguous doubles (rhs, size); raises ValueError for another shape."""
    forces = np.ascontiguousarray(forces, np.float64)
    if forces.ndim != 2 or forces.shape[1] != size:
        raise ValueError(f"forces of model {index}: shape {forces.shape}, expected (rhs, {size})")
    return forces
