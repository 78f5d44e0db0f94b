"""What a black box takes of the machine: seconds, memory, processes, folders.

``BlackBox.usage`` is asked for once and tells what has been taken so far. Seconds of codes and workers count from when
the workers were started; loading other models in the place of the first starts them anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Protocol, runtime_checkable

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


@runtime_checkable
class Usage(Protocol):
    """What a black box has taken so far; to be read between two requests, from the thread that makes them."""

    @property
    def asked(self) -> float:
        """Seconds of wall clock in which it had something to do, in all."""

    def clock(self) -> dict[str, float]:
        """The codes' own CPU seconds, summed over workers, for each of ``STAGES``."""

    def activity(self) -> list[Activity]:
        """What each worker has done with its time."""

    def codes(self) -> list[dict[str, object]]:
        """One entry per code, as in summary.json.

        Its keys: code (its name), transport, version, models (distinct ones it holds), workers, seconds (per stage and
        total), compliances (subdomains whose interface compliance it was asked for instead of a run per request, with
        the number of unit loads and the CPU seconds that took), own_matter (whether its matter is its own, not the YAML's).
        """

    def memory_peak_mb(self) -> float:
        """Largest resident memory of the codes' processes, MB, summed over workers."""

    def pids(self) -> list[int]:
        """Process ids of the codes' processes that run now."""

    def folders(self) -> list[Path]:
        """Where meshes and messages are written; removed with the black box."""


def summed(clocks: Iterable[dict[str, float]]) -> dict[str, float]:
    """Seconds per stage of several clocks together."""
    total = dict.fromkeys(STAGES, 0.0)
    for clock in clocks:
        for stage, seconds in clock.items():
            total[stage] += seconds
    return total
