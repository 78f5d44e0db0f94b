"""What a worker did with its time: the code's own seconds, messages, waiting and idleness make up the wall clock."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Activity:
    """One worker since it was started, or between two moments (``since``).

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
