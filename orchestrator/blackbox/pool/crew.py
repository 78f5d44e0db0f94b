"""Workers at work: a thread for each, tasks handed out, and the time in which nobody has one."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from orchestrator.blackbox.transport.worker import Worker

Task = tuple[int, Callable[[Worker, Any], Any], Any]  # number of the worker, function, its argument


def default_workers() -> int:
    """One worker per core this process may use."""
    return max(1, len(os.sched_getaffinity(0)))


class Crew:
    """Workers of one pool.

    Every worker has a thread of its own, which starts its process, waits for its answers and lives as long as the
    crew works: the kernel is asked to kill a process together with the thread that started it.

    Parameters
    ----------
    makers : each makes a new worker

    Attributes
    ----------
    workers : those at work, or the last ones that were
    asked : seconds in which some worker had a task, in all
    """

    def __init__(self, makers: Sequence[Callable[[], Worker]]):
        self._makers = makers
        self.workers: list[Worker] = []
        self.asked = 0.0
        self._since = time.perf_counter()
        self._asked = 0.0  # since the last start
        self._done: queue.SimpleQueue = queue.SimpleQueue()
        self._queues: list[queue.SimpleQueue] = []
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """New workers, all at once; raises what the first one to fail raises."""
        self._since, self._asked = time.perf_counter(), 0.0
        self.workers = [make() for make in self._makers]
        self._queues = [queue.SimpleQueue() for _ in self.workers]
        self._threads = [threading.Thread(target=self._serve, args=pair, name="blackbox", daemon=True)
                         for pair in zip(self.workers, self._queues)]
        for thread in self._threads:
            thread.start()
        self.run([(number, lambda worker, _: worker.open(), None) for number in range(len(self.workers))])

    def stop(self) -> None:
        """End all processes and threads; may be called twice."""
        self.kill()
        for tasks in self._queues:
            tasks.put(None)
        for thread in self._threads:
            if thread.is_alive() and thread is not threading.current_thread():
                thread.join()
        for worker in self.workers:
            worker.release()
        self._threads, self._queues = [], []

    def kill(self) -> None:
        """End all processes at once, without waiting for any thread."""
        for worker in self.workers:
            worker.kill()

    def run(self, tasks: Sequence[Task]) -> list:
        """Run tasks at once.

        Returns
        -------
        their results, in the order in which they came; the first failure is raised, and the crew is then of no use:
        answers are still under way, and what the workers would say next fits no question
        """
        begin, results = time.perf_counter(), []
        for number, work, argument in tasks:
            self._queues[number].put((work, argument))
        for _ in tasks:
            result, error = self._done.get()
            if error is not None:
                raise error
            results.append(result)
        self._asked += (seconds := time.perf_counter() - begin)
        self.asked += seconds
        return results

    def waited(self, worker: Worker) -> float:
        """Seconds without a task while another worker still had one."""
        return self._asked - worker.working

    def idle(self) -> float:
        """Seconds since the start in which nobody had a task."""
        return time.perf_counter() - self._since - self._asked

    def _serve(self, worker: Worker, tasks: queue.SimpleQueue) -> None:
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
