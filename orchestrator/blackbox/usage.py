"""A black box's use of the machine: seconds, memory, processes, folders.

Seconds of codes and workers count from when the workers were started; loading other models in the
place of the first starts them anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from orchestrator.timing import Doing

STAGES = ("start", "assemble", "factorise", "solve")  # of a code's own clock
CLOCKS = (*STAGES, "messages", "waiting", "idle")  # of a worker; they make up the wall clock
Activity = dict[str, float]  # of a worker, see ``Usage.activity``


def since(late: Activity, early: Activity) -> Activity:
    """The work of a worker between two moments."""
    return {key: value - early[key] if key in ("calls", *CLOCKS) else value
            for key, value in late.items()}


class Usage:
    """The time and memory that a pool has taken so far; to be read between two requests, from the
    thread that makes them.

    codes : its ``Code`` of each number
    teams : the numbers of the workers of each code
    workers : its ``Worker``s, by their numbers
    folder : where meshes and messages are written; removed with the black box
    asked : seconds of wall clock in which it had something to do, in all
    doing : what it does, or has done last, that takes long
    """

    def __init__(self, codes: Mapping[int, Any], teams: Mapping[int, range], folder: Path):
        self._codes, self._teams, self._folder = dict(codes), teams, folder
        self.workers: list[Any] = []
        self.doing: Doing | None = None
        self.asked = self._since = self._before = 0.0
        self.hold([], [])

    def begin(self, workers: Sequence) -> None:
        """Count the work of these workers from now on."""
        self.workers, self._since, self._before = list(workers), time.perf_counter(), self.asked

    def afresh(self) -> None:
        """Count from now on: another run goes on with the same workers."""
        for worker in self.workers:
            worker.calls, worker.working, worker.seconds = 0, 0.0, dict.fromkeys(STAGES, 0.0)
        self.asked = 0.0
        self.begin(self.workers)

    def hold(self, home: Sequence[int], dofs: Sequence[int]) -> None:
        """Take in which worker has each model, and how many free dofs that has."""
        self._home, self._dofs = home, dofs

    def timed(self, number: int, work: Callable[[Any, Any], dict], argument: Any) -> dict:
        """Do a worker's task, in its own thread."""
        begin, worker = time.perf_counter(), self.workers[number]
        try:
            return work(worker, argument)
        finally:
            worker.calls += 1
            worker.working += time.perf_counter() - begin

    def clock(self) -> dict[str, float]:
        """The codes' own CPU seconds, summed over workers, for each of ``STAGES``."""
        return _summed(self.workers)

    def activity(self) -> list[Activity]:
        """Each worker's use of its time since it was started.

        worker, models, dofs : which one, and what it holds now; dofs that are not clamped
        calls : tasks it was given; all subdomains of a linear stage are one
        start, assemble, factorise, solve : CPU seconds on the code's own clock
        messages : the rest of the seconds in which it had a task: bytes to and from the code and,
            on a busy machine, the code's wait for a core
        waiting : seconds without a task while another worker still had one: imbalance
        idle : seconds in which nobody had a task, because the orchestrator computed
        """
        asked, found = self.asked - self._before, []
        idle = time.perf_counter() - self._since - asked
        for number, worker in enumerate(self.workers):
            dofs = [n for n, home in zip(self._dofs, self._home) if home == number]
            found.append({"worker": number, "models": len(dofs), "dofs": sum(dofs),
                          "calls": worker.calls, **worker.seconds,
                          "messages": worker.working - sum(worker.seconds.values()),
                          "waiting": asked - worker.working, "idle": idle})
        return found

    def codes(self) -> list[dict[str, object]]:
        """One entry per code, as in summary.json.

        Its keys: code (its name), transport, version, models (distinct ones it holds), workers,
        seconds (per stage and total), compliances (subdomains whose interface compliance it was
        asked for instead of a run per request, with the number of unit loads and the CPU seconds
        that took), own_matter (whether its matter is its own, not the YAML's).
        """
        entries = []
        for number, code in self._codes.items():
            workers = [self.workers[worker] for worker in self._teams[number]]
            seconds = _summed(workers)
            entries.append({"code": code.name, "transport": code.settings.transport,
                            "version": code.version(),
                            "models": sum(home in self._teams[number] for home in self._home),
                "workers": len(workers), "seconds": {**seconds, "total": sum(seconds.values())},
                "compliances": [note for worker in workers for note in worker.compliances()],
                            "own_matter": workers[0].traits().own_matter})
        return entries

    def memory_peak_mb(self) -> float:
        """Largest resident memory of the codes' processes, MB, summed over workers."""
        return float(sum(worker.note_memory() for worker in self.workers))

    def pids(self) -> list[int]:
        """Process ids of the codes' processes that run now."""
        processes = [worker.process for worker in self.workers]
        return [p.pid for p in processes if p is not None and p.returncode is None]

    def folders(self) -> list[Path]:
        """Folders of meshes and messages; removed with the black box."""
        return [self._folder]


def _summed(workers: Sequence) -> dict[str, float]:
    """Seconds per stage of workers together."""
    return {stage: sum(worker.seconds[stage] for worker in workers) for stage in STAGES}
