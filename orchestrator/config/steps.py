"""Load steps: how many there are, and what every entry amounts to at each of them."""

from __future__ import annotations

from orchestrator.config.bolts import Bolt
from orchestrator.config.boundary import Acting
from orchestrator.config.entry import Entry as Law
from orchestrator.config.model import Config

Entry = Acting | Bolt | Law


def listed(entry: Entry) -> list | None:
    """The vectors that an entry lists, one per load step; None where it lists none."""
    if isinstance(entry, Acting):
        values = [entry.given] if entry.kind.listed else []
    else:
        values = [getattr(entry, key) for key in getattr(entry, "per_step", ())]
    return next(filter(is_per_step, values), None)


def is_per_step(vector: list) -> bool:
    """Whether a value lists one vector per load step."""
    return isinstance(vector[0], list)


def steps(config: Config) -> int:
    """Number of load steps: the length of the histories in use and of the per-step lists; else 1."""
    for entry in (*config.boundary, *config.loads, *config.interfaces, *config.bolts):
        if entry.history is not None:
            return len(config.histories[entry.history])
        if (vectors := listed(entry)) is not None:
            return len(vectors)
    for part in config.parts or []:
        if part.foreign is not None and part.foreign.history is not None:
            return len(config.histories[part.foreign.history])
        files = getattr(part.foreign, "loads", None)
        if isinstance(files, list) and len(files) > 1:
            return len(files)
    return 1


def factors(entry: Entry, config: Config) -> list[float]:
    """What multiplies the entry at every load step."""
    return [1.0] * steps(config) if entry.history is None else list(config.histories[entry.history])
