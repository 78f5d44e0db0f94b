"""What a black box takes of the machine: seconds, memory, processes, folders.

Seconds of codes and workers count from when the workers were started; loading other models in the place of the first starts
them anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

STAGES = ("start", "assemble", "factorise", "solve")  # of a code's own clock


@dataclass(frozen=True)
class Activity:
    """One worker since it was started, or between two moments (``since``).

    The code's own seconds, messages, waiting and idleness make up the wall clock.

    Parameters
    ----------
    worker : its number
    models, dofs : that it holds now; dofs that are not clamped
    calls : tasks it was given; all subdomains of a linear stage are one
    start, assemble, factorise, solve : CPU seconds on the code's own clock
    messages : the rest of the seconds in which it had a task: bytes to and from the code and, on a busy machine,
        the code's wait for a core
    waiting : seconds without a task while another worker still had one: imbalance
    idle : seconds in which nobody had a task, because the orchestrator computed
    """

    worker: int
    models: int
    dofs: int
    calls: int
    start: float
    assemble: float
    factorise: float
    solve: float
    messages: float
    waiting: float
    idle: float

    def since(self, before: "Activity") -> "Activity":
        """What was added since an earlier moment."""
        kept = {name: getattr(self, name) for name in ("worker", "models", "dofs")}
        return Activity(**kept, **{f.name: getattr(self, f.name) - getattr(before, f.name)
                                   for f in fields(self) if f.name not in kept})

    @property
    def code(self) -> float:
        """All seconds of the code."""
        return self.start + self.assemble + self.factorise + self.solve

    @property
    def seconds(self) -> float:
        """All seconds."""
        return self.code + self.messages + self.waiting + self.idle


class Usage:
    """What a pool has taken so far; to be read between two requests, from the thread that makes them.

    Parameters
    ----------
    crew : the pool's ``Crew``
    codes : its ``Code`` of each number
    teams : the workers of each code
    place : its folder
    """

    def __init__(self, crew, codes: Mapping, teams: Mapping[int, Sequence[int]], place: Path):
        self._crew, self._codes, self._teams, self._folder = crew, codes, teams, place
        self._held: list[tuple[int, int]] = []  # worker, model
        self._dofs: Sequence[int] = []

    def hold(self, places: Iterable, dofs: Sequence[int]) -> None:
        """Take in the ``Sharing`` of each code, and how many free dofs each model has."""
        self._held = [(worker, model) for place in places for model, workers in place.holders.items() for worker in workers]
        self._dofs = dofs

    @property
    def asked(self) -> float:
        """Seconds of wall clock in which it had something to do, in all."""
        return self._crew.asked

    def clock(self) -> dict[str, float]:
        """The codes' own CPU seconds, summed over workers, for each of ``STAGES``."""
        return _summed(self._crew.workers)

    def activity(self) -> list[Activity]:
        """What each worker has done with its time."""
        idle, found = self._crew.idle(), []
        for number, worker in enumerate(self._crew.workers):
            dofs = [self._dofs[model] for holder, model in self._held if holder == number]
            found.append(Activity(number, len(dofs), sum(dofs), worker.calls, **worker.seconds, waiting=self._crew.waited(worker),
                                  messages=worker.working - sum(worker.seconds.values()), idle=idle))
        return found

    def codes(self) -> list[dict[str, object]]:
        """One entry per code, as in summary.json.

        Its keys: code (its name), transport, version, models (distinct ones it holds), workers, seconds (per stage and
        total), compliances (subdomains whose interface compliance it was asked for instead of a run per request, with
        the number of unit loads and the CPU seconds that took), own_matter (whether its matter is its own, not the YAML's).
        """
        entries = []
        for number, code in self._codes.items():
            workers = [self._crew.workers[worker] for worker in self._teams[number]]
            seconds = _summed(workers)
            entries.append({
                "code": code.name, "transport": code.settings.transport, "version": code.version(),
                "models": len({model for worker, model in self._held if worker in self._teams[number]}),
                "workers": len(workers), "seconds": {**seconds, "total": sum(seconds.values())},
                "compliances": [note for worker in workers for note in worker.compliances()],
                "own_matter": workers[0].traits().own_matter})
        return entries

    def memory_peak_mb(self) -> float:
        """Largest resident memory of the codes' processes, MB, summed over workers."""
        return float(sum(worker.note_memory() for worker in self._crew.workers))

    def pids(self) -> list[int]:
        """Process ids of the codes' processes that run now."""
        processes = [worker.process for worker in self._crew.workers]
        return [p.pid for p in processes if p is not None and p.returncode is None]

    def folders(self) -> list[Path]:
        """Where meshes and messages are written; removed with the black box."""
        return [self._folder]


def _summed(workers: Sequence) -> dict[str, float]:
    """Seconds per stage of workers together."""
    return {stage: sum(worker.seconds[stage] for worker in workers) for stage in STAGES}
