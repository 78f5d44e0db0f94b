"""The pool: models go to the workers of their codes, all of them work at once, and all end when one
fails.

Every worker has a thread of its own for as long as it works: the kernel kills a process together
with the thread that started it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator import folders, processes
from orchestrator.blackbox.codes.code import Code
from orchestrator.blackbox.protocol import BlackBox, Model, Traits
from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.transport.worker import Ended, Worker
from orchestrator.blackbox.usage import Usage
from orchestrator.timing import Doing, predicted_cost
from orchestrator.errors import BlackBoxError

MANY = 8  # right-hand sides of a model, from which they are told piece by piece


def longest_first(costs: Sequence[float], workers: int) -> list[list[int]]:
    """Tasks of every worker: each task, longest first, goes to the worker with the least to do."""
    tasks: list[list[int]] = [[] for _ in range(workers)]
    busy = np.zeros(workers)
    for index in np.argsort(-np.asarray(costs, float), kind="stable"):
        worker = int(np.argmin(busy))
        tasks[worker].append(int(index))
        busy[worker] += costs[index]
    return tasks


class Pool(BlackBox):
    """Processes of finite element codes.

    codes : ``Model.code`` → what to run, with its settings: how many processes at once, by which
        transport
    Raises InputError or BlackBoxError where processes do not start; none is left then.
    """

    def __init__(self, codes: Mapping[int, Code]):
        self._models: list[Model] = []
        self._home: list[int] = []  # of each model, the worker that has it: its factor is there
        self._broken, self._closed = "", False
        self._threads: list[ThreadPoolExecutor] = []
        self._folder = folders.make()
        processes.watch(self)
        self._teams: dict[int, range] = {}  # the workers of each code
        self._makers: list[Callable[[], Worker]] = []
        for number, code in codes.items():
            wanted, first = code.settings.workers, len(self._makers)
            count = len(os.sched_getaffinity(0)) if wanted == "auto" else wanted
            self._teams[number] = range(first, first + count)
            self._makers += [lambda code=code, own=self._folder
                             / f"code-{number}", worker=worker: code.worker()(code, own, worker)
                             for worker in self._teams[number]]
        self.usage = Usage(codes, self._teams, self._folder)
        with self._ending():
            for number, code in codes.items():
                (own := self._folder / f"code-{number}").mkdir()
                for name, text in code.files().items():
                    (own / name).write_text(text, encoding="utf-8")
            self._start()

    def ready(self) -> None:
        """Nothing is to be done."""

    def load(self, models: Sequence[Model]) -> None:
        """Load models; raises InputError when the disk is full."""
        if self._models:
            self._stop()
            with self._ending():
                self._start()
        # Longest first to whoever is free would balance the factorisations alone: on 100 grains the
        # busier of two
        # workers then has 4 % more back-substitutions than the mean, instead of 0.1 %. They stay
        # where the factor is.
        self._models, dofs = list(models), [int((~model.fixed).sum()) for model in models]
        costs = predicted_cost(dofs).tolist()
        tasks = self._placed(models, costs)
        home = {index: worker for worker, own in tasks.items() for index in own}
        self._home = [home[index] for index in range(len(models))]
        self._each("assembling", lambda worker, i: worker.load(i, models[i]), tasks,
                   dict(enumerate(costs)))
        self.usage.hold(self._home, dofs)

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        return self._solve(messages.TRACES,
                           {i: _rows(i, f, len(self._models[i].trace)) for i, f in forces.items()})

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        # an eliminated dof answers its right-hand side, not zero
        fixed = {i: self._models[i].fixed.ravel() for i in forces}
        answers = self._solve(messages.FIELDS,
                              {i: np.where(fixed[i], 0.0, _rows(i, f, len(fixed[i])))
                               for i, f in forces.items()})
        for i, u in answers.items():
            u[:, fixed[i]] = 0.0
        return answers

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        return self._asked_about(models, lambda worker, i, model: worker.stiffness(i, model))

    def own_loads(self, models: Sequence[Model], steps: int) -> list[np.ndarray]:
        """(steps, 3n) nodal forces of each model that are the code's own, see
        ``CodeSettings.brings_loads``.
        """
        return self._asked_about(models, lambda worker, i, model: worker.own_loads(i, model, steps))

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        return self._run(
            lambda worker, own: {i: worker.advance(i, forces[i], commit, self._models[i].name)
                                 for i in own},
                         self._at_home(forces))

    def traits(self, code: int = 0) -> Traits:
        """Traits that the code declares, or where it leaves that open, its process."""
        return self.usage.workers[self._teams[code][0]].traits()

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._stop()
            folders.remove(self._folder)
            processes.forget(self)

    def kill(self) -> None:
        """End all processes at once and remove all files, without waiting for any thread."""
        self._closed = True
        for worker in self.usage.workers:
            worker.kill()
        folders.remove(self._folder)

    def _start(self) -> None:
        """New workers, all at once; raises what the first one to fail raises."""
        self._threads = [ThreadPoolExecutor(1, "blackbox") for _ in self._makers]
        self.usage.begin([make() for make in self._makers])
        self._at_once(lambda worker, _: worker.open() or {},
                      dict.fromkeys(range(len(self._makers))))

    def _stop(self) -> None:
        for worker in self.usage.workers:
            worker.kill()
        for thread in self._threads:
            thread.shutdown()
        for worker in self.usage.workers:
            worker.release()

    def _placed(self, models: Sequence[Model], costs: Sequence[float]) -> dict[int, list[int]]:
        """Worker → the models that it is to have."""
        tasks = {}
        for code, team in self._teams.items():
            own = [i for i, model in enumerate(models) if model.code == code]
            for worker, chosen in zip(team, longest_first([costs[i] for i in own], len(team))):
                tasks[worker] = [own[place] for place in chosen]
        return tasks

    def _at_home(self, models: Iterator[int] | Mapping[int, Any]) -> dict[int, list[int]]:
        tasks: dict[int, list[int]] = {}
        for index in models:
            tasks.setdefault(self._home[index], []).append(index)
        return tasks

    def _each(self, what: str, work: Callable[[Worker, int], Any],
              tasks: Mapping[int, list[int]], costs: Mapping[int, float]) -> dict:
        """Results of ``work(worker, model)`` for each model; what it costs is told when it is
        done.
        """
        workers = sum(map(bool, tasks.values()))
        self.usage.doing = doing = Doing(what, sum(costs.values()), len(costs), workers)

        def one(worker: Worker, i: int) -> Any:
            result = work(worker, i)
            doing.finish(costs[i])
            return result

        return self._run(lambda worker, own: {i: one(worker, i) for i in own}, tasks)

    def _run(self, work: Callable[[Worker, list[int]], dict],
             tasks: Mapping[int, list[int]]) -> dict:
        """Results of ``work(worker, models)`` for each worker that has any; the first failure ends
        the pool and is raised.
        """
        if self._closed:
            raise BlackBoxError(self._broken or "the black box is closed")
        with self._ending():
            return self._at_once(work, {number: own for number, own in tasks.items() if own})

    def _at_once(self, work: Callable[[Worker, Any], dict], tasks: Mapping[int, Any]) -> dict:
        begin, united = time.perf_counter(), {}
        asked = [self._threads[number].submit(self.usage.timed, number, work, own)
                 for number, own in tasks.items()]
        for done in as_completed(asked) if len(asked) > 1 else asked:
            united |= done.result()
        self.usage.asked += time.perf_counter() - begin
        return united

    def _asked_about(self, models: Sequence[Model],
                     ask: Callable[[Worker, int, Model], Any]) -> list:
        """Answers about models that are not kept; numbers of their own overwrite no mesh file of a
        loaded one.
        """
        first = len(self._models)
        found = self._run(lambda worker, own: {i: ask(worker, first + i, models[i]) for i in own},
                          self._placed(models, [len(model.cells) for model in models]))
        return [found[i] for i in range(len(models))]

    def _solve(self, op: int, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Displacements of each model; many of each are asked for model by model."""
        def solved(worker: Worker, own: list[int]) -> dict[int, np.ndarray]:
            names = [self._models[i].name for i in own]
            return worker.solve(op, [(i, forces[i]) for i in own], names)

        rows = {i: len(f) for i, f in forces.items() if f.size}
        if sum(rows.values()) > MANY * len(rows):
            answers = self._each("back-substitutions", lambda worker, i: solved(worker, [i])[i],
                                 self._at_home(rows), rows)
        else:
            answers = self._run(solved, self._at_home(rows))
        return {i: answers[i] if f.size else f.copy() for i, f in forces.items()}

    @contextmanager
    def _ending(self) -> Iterator[None]:
        """End the pool on whatever is raised within."""
        try:
            yield
        except BaseException as error:
            self._broken = (
                f"the black box has ended after a failure: {str(error) or type(error).__name__}")
            self.close()
            if isinstance(error, Ended):
                raise BlackBoxError(str(error)) from error
            raise


def _rows(index: int, forces: np.ndarray, size: int) -> np.ndarray:
    """Forces of a model as contiguous doubles (rhs, size); raises ValueError for another shape."""
    forces = np.ascontiguousarray(forces, np.float64)
    if forces.ndim != 2 or forces.shape[1] != size:
        raise ValueError(f"forces of model {index}: shape {forces.shape}, expected (rhs, {size})")
    return forces
