"""The pool: places models on workers, keeps all of them busy, and ends them all when one fails."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.pool import lifetime, workdir

from orchestrator.blackbox.transport import messages
from orchestrator.blackbox.pool.activity import Activity
from orchestrator.blackbox.protocol import Model
from orchestrator.blackbox.pool.worker import Code, Ended, Worker
from orchestrator.cost import predicted_cost
from orchestrator.errors import BlackBoxError


def default_workers() -> int:
    """One worker per core this process may use."""
    return max(1, len(os.sched_getaffinity(0)))


def place(costs: Sequence[float], workers: int) -> list[list[int]]:
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

    Every worker has a thread of its own, which starts its process, waits for its answers and lives as
    long as the pool: the kernel is asked to kill a process together with the thread that started it.

    Parameters
    ----------
    worker_class : the transport
    code, element : what to run
    workers : how many at once
    timeout : seconds one answer may take
    """

    def __init__(self, worker_class: type[Worker], code: Code, element: str, workers: int, timeout: float):
        self._models: list[Model] = []
        self._home: dict[int, int] = {}
        self._started = time.perf_counter()
        self._asked = self.asked = 0.0  # seconds in which some worker had a task: since the last start, and in all
        self._broken: str = ""
        self._closed = False
        self._done: queue.SimpleQueue = queue.SimpleQueue()
        self._folder = workdir.make()
        lifetime.watch(self)
        self._make = lambda number: worker_class(code, element, self._folder, number, timeout)
        self._code, self._count = code, workers
        self._transport = next((name for name, kind in code.transports.items() if kind is worker_class), "")
        self._workers: list[Worker] = []
        self._queues: list[queue.SimpleQueue] = []
        self._threads: list[threading.Thread] = []
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    # ---- the protocol -------------------------------------------------------------------------

    def load(self, models: Sequence[Model]) -> None:
        """Assemble and factorise every model; models loaded before are forgotten.

        Raises BlackBoxError, among others for a model that can still move freely; InputError when
        the disk is full.
        """
        if self._home:
            self._stop()
            self._start()
            self._home = {}
        # Longest first to whoever is free would balance the factorisations alone: on 100 grains the busier of two
        # workers then has 4 % more back-substitutions than the mean, instead of 0.1 %. They stay where the factor is.
        tasks = place(predicted_cost([(~model.fixed).sum() for model in models]), self._count)
        self._models = list(models)
        self._home = {index: worker for worker, indices in enumerate(tasks) for index in indices}

        def load_all(worker: Worker, indices: list[int]) -> None:
            for index in indices:
                worker.load(index, self._models[index])

        self._run([(w, load_all, indices) for w, indices in enumerate(tasks) if indices])

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Nodal forces (rhs, t) on each model's trace dofs to the displacements (rhs, t) there."""
        wanted = {i: self._two_dimensional(i, f, len(self._models[i].trace)) for i, f in forces.items()}
        return self._solve(messages.TRACES, wanted)

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Nodal forces (rhs, 3n) to all displacements (rhs, 3n); forces on clamped dofs are ignored."""
        wanted = {}
        for i, f in forces.items():
            model = self._models[i]
            # an eliminated dof answers its right-hand side, not zero
            wanted[i] = np.where(model.fixed.ravel(), 0.0, self._two_dimensional(i, f, 3 * len(model.nodes)))
        answers = self._solve(messages.FIELDS, wanted)
        for i, u in answers.items():
            u[:, self._models[i].fixed.ravel()] = 0.0
        return answers

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """Stiffness matrices (3n, 3n), symmetric, without regard to ``fixed`` and ``trace``."""
        matrices: list[sp.csr_array | None] = [None] * len(models)
        # numbers of their own, so that no mesh file of a loaded model is overwritten
        first = len(self._models)

        def assemble_all(worker: Worker, indices: list[int]) -> None:
            for index in indices:
                matrices[index] = worker.stiffness(first + index, models[index])

        tasks = place([len(model.cells) for model in models], self._count)
        self._run([(w, assemble_all, indices) for w, indices in enumerate(tasks) if indices])
        return matrices

    def clock(self) -> dict[str, float]:
        """The code's own CPU seconds, summed over workers: start, assemble, factorise, solve."""
        total = {"start": 0.0, "assemble": 0.0, "factorise": 0.0, "solve": 0.0}
        for worker in self._workers:
            for stage, seconds in worker.seconds.items():
                total[stage] += seconds
        return total

    def activity(self) -> list[Activity]:
        """What every worker has done with its time so far; between two tasks, from the caller's thread."""
        idle = time.perf_counter() - self._started - self._asked
        held: list[list[Model]] = [[] for _ in self._workers]
        for index, number in self._home.items():
            held[number].append(self._models[index])
        return [
            Activity(number, len(models), sum(int((~m.fixed).sum()) for m in models), worker.calls, **worker.seconds,
                     messages=worker.working - sum(worker.seconds.values()), waiting=self._asked - worker.working,
                     idle=idle)
            for number, (worker, models) in enumerate(zip(self._workers, held))
        ]

    def codes(self) -> list[dict[str, object]]:
        """One entry per code: name, transport, version, distinct models, CPU seconds by kind of work and in all, and the
        subdomains whose interface compliance was asked for once instead of a run per request."""
        seconds = self.clock()
        asked = [note for worker in self._workers for note in worker.compliances()]
        return [{"code": self._code.name, "transport": self._transport, "version": self._code.version(),
                 "models": len(self._models), "workers": self._count,
                 "seconds": {**seconds, "total": sum(seconds.values())}, "compliances": asked}]

    def version(self) -> dict[str, str]:
        """Name and version of the code."""
        return {self._code.name: self._code.version()}

    def memory_peak_mb(self) -> float:
        """Largest resident memory of the code's processes, MB, summed over workers."""
        return float(sum(worker.note_memory() for worker in self._workers))

    @property
    def folder(self) -> Path:
        """Where meshes and messages are written; removed with the pool."""
        return self._folder

    def pids(self) -> list[int]:
        """Process ids of the code's processes that run now."""
        processes = [worker.process for worker in self._workers]
        return [p.pid for p in processes if p is not None and p.returncode is None]

    def close(self) -> None:
        """End all processes and remove all files; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self._stop()
        workdir.remove(self._folder)
        lifetime.forget(self)

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    # ---- workers and threads ------------------------------------------------------------------

    def kill(self) -> None:
        """End all processes at once and remove all files, without waiting for any thread."""
        self._closed = True
        for worker in self._workers:
            worker.kill()
        workdir.remove(self._folder)

    def _start(self) -> None:
        self._started, self._asked = time.perf_counter(), 0.0
        self._workers = [self._make(number) for number in range(self._count)]
        self._queues = [queue.SimpleQueue() for _ in self._workers]
        self._threads = [
            threading.Thread(target=self._serve, args=(w,), name=f"blackbox-{w}", daemon=True)
            for w in range(self._count)
        ]
        for thread in self._threads:
            thread.start()
        self._run([(w, lambda worker, _: worker.open(), None) for w in range(self._count)])

    def _stop(self) -> None:
        for worker in self._workers:
            worker.kill()
        for tasks in self._queues:
            tasks.put(None)
        for thread in self._threads:
            if thread.is_alive() and thread is not threading.current_thread():
                thread.join()
        for worker in self._workers:
            worker.release()
        self._threads, self._queues = [], []

    def _serve(self, number: int) -> None:
        worker, tasks = self._workers[number], self._queues[number]
        while (task := tasks.get()) is not None:
            work, argument = task
            begin, result, failure = time.perf_counter(), None, None
            try:
                result = work(worker, argument)
            except BaseException as error:  # noqa: BLE001 - handed over to the caller's thread
                failure = error
            worker.calls += 1
            worker.working += time.perf_counter() - begin
            self._done.put((result, failure))

    def _run(self, tasks: Sequence[tuple[int, Callable[[Worker, Any], Any], Any]]) -> list:
        """Run (worker, function, argument) tasks at once; the first failure ends the pool and is raised."""
        if self._closed:
            raise BlackBoxError(self._broken or "the black box is closed")
        begin, results = time.perf_counter(), []
        for number, work, argument in tasks:
            self._queues[number].put((work, argument))
        try:
            for _ in tasks:
                result, error = self._done.get()
                if error is not None:
                    raise error
                results.append(result)
        except BaseException as error:
            # Answers are still under way: what the workers would say next fits no question.
            self._broken = f"the black box has ended after a failure: {str(error) or type(error).__name__}"
            self.close()
            if isinstance(error, Ended):
                raise BlackBoxError(str(error)) from error
            raise
        self._asked += (seconds := time.perf_counter() - begin)
        self.asked += seconds
        return results

    def _solve(self, op: int, forces: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        jobs: dict[int, list] = {}
        for index, f in forces.items():
            if f.size:
                jobs.setdefault(self._home[index], []).append((index, f))

        def solve_all(worker: Worker, some: list) -> dict[int, np.ndarray]:
            return worker.solve(op, some, [self._models[index].name for index, _ in some])

        answers: dict[int, np.ndarray] = {}
        for part in self._run([(w, solve_all, some) for w, some in jobs.items()]):
            answers.update(part)
        return {index: answers[index] if f.size else f.copy() for index, f in forces.items()}

    @staticmethod
    def _two_dimensional(index: int, forces: np.ndarray, size: int) -> np.ndarray:
        forces = np.ascontiguousarray(forces, np.float64)
        if forces.ndim != 2 or forces.shape[1] != size:
            raise ValueError(f"forces of model {index}: shape {forces.shape}, expected (rhs, {size})")
        return forces
