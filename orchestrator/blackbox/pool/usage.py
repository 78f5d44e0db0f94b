"""What a pool of workers has taken of the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.blackbox.pool.crew import Crew
from orchestrator.blackbox.usage import Activity, summed

if TYPE_CHECKING:
    from orchestrator.blackbox.codes.code import Code


class PoolUsage:
    """The ``usage.Usage`` of a pool.

    Parameters
    ----------
    crew, code, folder : of the pool
    """

    def __init__(self, crew: Crew, code: Code, folder: Path):
        self._crew, self._code, self._folder = crew, code, folder
        self._held: list[list[int]] = []
        self._models = 0  # different ones

    def hold(self, holders: Mapping[int, Sequence[int]], dofs: list[int]) -> None:
        """Say which workers hold which model (key), and how many free dofs each model has."""
        self._held, self._models = [[] for _ in range(self._crew.count)], len(holders)
        for index, workers in holders.items():
            for worker in workers:
                self._held[worker].append(dofs[index])

    @property
    def asked(self) -> float:
        """As the protocol says."""
        return self._crew.asked

    def clock(self) -> dict[str, float]:
        """As the protocol says."""
        return summed(worker.seconds for worker in self._crew.workers)

    def activity(self) -> list[Activity]:
        """As the protocol says."""
        idle, held = self._crew.idle(), self._held or [[]] * self._crew.count
        return [
            Activity(number, len(dofs), sum(dofs), worker.calls, **worker.seconds,
                     messages=worker.working - sum(worker.seconds.values()), waiting=self._crew.waited(worker),
                     idle=idle)
            for number, (worker, dofs) in enumerate(zip(self._crew.workers, held))
        ]

    def codes(self) -> list[dict[str, object]]:
        """As the protocol says."""
        seconds = self.clock()
        asked = [note for worker in self._crew.workers for note in worker.compliances()]
        return [{"code": self._code.name, "transport": self._code.settings.transport,
                 "version": self._code.version(), "models": self._models, "workers": self._crew.count,
                 "seconds": {**seconds, "total": sum(seconds.values())}, "compliances": asked,
                 "own_matter": self._crew.workers[0].traits().own_matter}]

    def memory_peak_mb(self) -> float:
        """As the protocol says."""
        return float(sum(worker.note_memory() for worker in self._crew.workers))

    def pids(self) -> list[int]:
        """As the protocol says."""
        processes = [worker.process for worker in self._crew.workers]
        return [p.pid for p in processes if p is not None and p.returncode is None]

    def folders(self) -> list[Path]:
        """As the protocol says."""
        return [self._folder]
