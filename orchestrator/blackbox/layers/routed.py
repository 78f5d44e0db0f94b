"""Several black boxes as one: each model goes to the code that is to solve it, all codes work at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import BlackBox, Model, Traits
from orchestrator.blackbox.usage import Activity, Usage, summed
from orchestrator.errors import BlackBoxError


class Routed:
    """The black box of ``protocol.BlackBox`` over pools of different codes or transports.

    Parameters
    ----------
    pools : ``Model.code`` → the black box of that code, a pool; closed with this one
    """

    def __init__(self, pools: Mapping[int, BlackBox]):
        self.pools = dict(pools)
        self._home: list[tuple[int, int]] = []  # (code, number in its pool) of every model
        self._ended = ""
        self._threads = ThreadPoolExecutor(len(self.pools), "routed")
        self._usage = RoutedUsage([pool.usage for pool in self.pools.values()])

    def load(self, models: Sequence[Model]) -> None:
        """As the protocol says."""
        parts: dict[int, list[Model]] = {code: [] for code in self.pools}
        self._home = []
        for model in models:
            self._home.append((model.code, len(parts[model.code])))
            parts[model.code].append(model)
        self._all({code: lambda pool, part=part: pool.load(part) for code, part in parts.items() if part})

    def traces(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self._solved(forces, lambda pool, part: pool.traces(part))

    def fields(self, forces: Mapping[int, np.ndarray]) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self._solved(forces, lambda pool, part: pool.fields(part))

    def stiffness(self, models: Sequence[Model]) -> list[sp.csr_array]:
        """As the protocol says."""
        members = {code: [i for i, m in enumerate(models) if m.code == code] for code in self.pools}
        answers = self._all({code: lambda pool, own=own: pool.stiffness([models[i] for i in own])
                             for code, own in members.items() if own})
        found = {i: matrix for code, matrices in answers.items() for i, matrix in zip(members[code], matrices)}
        return [found[i] for i in range(len(models))]

    def advance(self, forces: Mapping[int, np.ndarray], commit: bool) -> dict[int, np.ndarray]:
        """As the protocol says."""
        return self._solved(forces, lambda pool, part: pool.advance(part, commit))

    def traits(self, code: int = 0) -> Traits:
        """As the protocol says."""
        return self.pools[code].traits(code)

    @property
    def usage(self) -> "RoutedUsage":
        """As the protocol says."""
        return self._usage

    def close(self) -> None:
        """As the protocol says."""
        self._ended = self._ended or "the black box is closed"
        for pool in self.pools.values():
            pool.close()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def __enter__(self) -> "Routed":
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def _solved(self, forces: Mapping[int, np.ndarray], ask: Callable) -> dict[int, np.ndarray]:
        parts: dict[int, dict[int, np.ndarray]] = {}
        for index, f in forces.items():
            code, number = self._home[index]
            parts.setdefault(code, {})[number] = f
        answers = self._all({code: lambda pool, part=part: ask(pool, part) for code, part in parts.items()})
        return {index: answers[self._home[index][0]][self._home[index][1]] for index in forces}

    def _all(self, tasks: Mapping[int, Callable[[BlackBox], Any]]) -> dict[int, Any]:
        """Run one task per code at once; the first failure ends all codes and is raised."""
        if self._ended:
            raise BlackBoxError(self._ended)
        begin = time.perf_counter()
        futures = {self._threads.submit(task, self.pools[code]): code for code, task in tasks.items()}
        try:
            left = set(futures)
            while left:
                done, left = wait(left, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
        except BaseException as error:
            self.close()
            self._ended = f"the black box has ended after a failure: {str(error) or type(error).__name__}"
            raise
        self._usage.asked += time.perf_counter() - begin
        return {code: future.result() for future, code in futures.items()}


class RoutedUsage:
    """The ``usage.Usage`` of several black boxes that work at the same time.

    Attributes
    ----------
    asked : seconds in which any of them had something to do; while they were started, one after the other
    """

    def __init__(self, parts: Sequence[Usage]):
        self._parts = parts
        self.asked = sum(part.asked for part in parts)

    def clock(self) -> dict[str, float]:
        """As the protocol says."""
        return summed(part.clock() for part in self._parts)

    def activity(self) -> list[Activity]:
        """Workers of all codes, numbered one after the other; each is idle while its own code has nothing to do."""
        rows = [row for part in self._parts for row in part.activity()]
        return [replace(row, worker=number) for number, row in enumerate(rows)]

    def codes(self) -> list[dict[str, object]]:
        """As the protocol says."""
        return [entry for part in self._parts for entry in part.codes()]

    def memory_peak_mb(self) -> float:
        """As the protocol says."""
        return sum(part.memory_peak_mb() for part in self._parts)

    def pids(self) -> list[int]:
        """As the protocol says."""
        return [pid for part in self._parts for pid in part.pids()]

    def folders(self) -> list[Path]:
        """As the protocol says."""
        return [folder for part in self._parts for folder in part.folders()]
