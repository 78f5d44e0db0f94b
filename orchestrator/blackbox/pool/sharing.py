"""Which workers hold which models, and who answers what: a slow worker does not hold up the others for long.

A model's factor is where it was made, so that at first every worker answers for its own models alone. Where the slowest one
has been taking much longer than the mean, in all requests so far, some of its models are loaded by others too, once, if
the seconds saved in the requests to come outweigh those of the new factors. From then on these models wait in a common
queue: who has answered for its own takes from it, batch after batch.

Seconds are of wall clock, so that it does not matter why a worker is slow: a cost that was predicted wrongly, a core of
another speed, another program on the same core.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from orchestrator.blackbox.cost import STAGES, to_come

IMBALANCE = 1.3  # seconds of the slowest worker over the mean from which models are loaded elsewhere too
LEAST = 3  # requests before that is judged: the first answers take longer
NOTICED = 1.0  # seconds that are to be saved at least: below that the clock tells noise


def longest_first(costs: Sequence[float], workers: int) -> list[list[int]]:
    """Tasks of every worker: each task, longest first, goes to the worker with the least to do."""
    tasks: list[list[int]] = [[] for _ in range(workers)]
    busy = np.zeros(workers)
    for index in np.argsort(-np.asarray(costs, float), kind="stable"):
        worker = int(np.argmin(busy))
        tasks[worker].append(int(index))
        busy[worker] += costs[index]
    return tasks


def gathered(pairs: Iterable[tuple[int, int]]) -> dict[int, list[int]]:
    """The second of all pairs, by the first."""
    found: dict[int, list[int]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


class Sharing:
    """The places of the models of one code.

    Parameters
    ----------
    tasks : number of each worker of the code → its models
    costs : model → its cost, predicted
    loading : seconds that each worker took to load its models, by its number

    Attributes
    ----------
    holders : per model, the workers that hold it, the first of which has from the beginning
    """

    def __init__(self, tasks: Mapping[int, Sequence[int]], costs: Mapping[int, float], loading: Mapping[int, float]):
        self.workers = list(tasks)
        self.holders = {model: [worker] for worker, models in tasks.items() for model in models}
        self.costs, self.loading = costs, np.array([loading.get(worker, 0.0) for worker in tasks])
        self.load = np.array([sum(costs[model] for model in models) for models in tasks.values()])
        self.busy, self.requests = np.zeros(len(tasks)), 0
        self.settled = len(tasks) < 2

    def answered(self, busy: Mapping[int, float]) -> None:
        """Take in the seconds of the workers in one request."""
        if not self.settled:
            self.requests += 1
            self.busy += [busy.get(worker, 0.0) for worker in self.workers]

    @property
    def imbalance(self) -> float:
        """Seconds of the slowest worker over the mean."""
        mean = self.busy.mean()
        return float(self.busy.max() / mean) if mean > 0 else 1.0

    def moves(self) -> list[tuple[int, int]]:
        """Models and the workers that are to load them too; none where that does not pay, or has been done."""
        if self.settled or self.requests < LEAST or self.imbalance <= IMBALANCE:
            return []
        at = self.busy / self.requests
        # a worker without models is as quick as the quickest one
        rate, cost = (np.where(self.load > 0, x / np.maximum(self.load, 1e-300), np.inf) for x in (at, self.loading))
        rate, cost = (np.where(np.isfinite(x), x, x.min()) for x in (rate, cost))
        slow, spent, found = int(np.argmax(at)), np.zeros(len(at)), []
        own = sorted((m for m, holders in self.holders.items() if holders == [self.workers[slow]]), key=lambda m: -self.costs[m])
        after = at.copy()
        for model in own:
            quick, size = int(np.argmin(after)), self.costs[model]
            if max(after[quick] + size * rate[quick], after[slow] - size * rate[slow]) < after[slow]:
                after[slow] -= size * rate[slow]
                after[quick] += size * rate[quick]
                spent[quick] += size * cost[quick]
                found.append((model, self.workers[quick]))
        gain = (at.max() - after.max()) * to_come(self.requests, STAGES)
        return found if gain > max(NOTICED, spent.max(initial=0.0)) else []

    def settle(self, moves: Iterable[tuple[int, int]]) -> None:
        """These models are where they were and with these workers too; there they stay."""
        for model, worker in moves:
            self.holders[model].append(worker)
        self.settled = True

    def tasks(self, models: Iterable[int]) -> tuple[dict[int, list[int]], Queue]:
        """What each worker answers alone, and what those who are done with that share."""
        alone: dict[int, list[int]] = {}
        shared: list[int] = []
        for model in models:
            holders = self.holders[model]
            (shared if len(holders) > 1 else alone.setdefault(holders[0], [])).append(model)
        queue = Queue(sorted(shared, key=lambda m: -self.costs[m]), self.holders)
        for worker in queue.takers:
            alone.setdefault(worker, [])
        return alone, queue


class Queue:
    """Models that several workers can answer for, the dearest first.

    Attributes
    ----------
    takers : workers that may take some
    """

    def __init__(self, models: Sequence[int], holders: Mapping[int, Sequence[int]]):
        self._left, self._holders, self._lock = deque(models), holders, threading.Lock()
        self.takers = {worker for model in models for worker in holders[model]}

    def take(self, worker: int) -> list[int]:
        """The next batch for a worker, smaller the fewer are left; empty when there is nothing more for it."""
        with self._lock:
            size, batch, passed = -(-len(self._left) // (2 * max(1, len(self.takers)))), [], []
            while self._left and len(batch) < size:
                model = self._left.popleft()
                (batch if worker in self._holders[model] else passed).append(model)
            self._left.extendleft(reversed(passed))
            return batch
