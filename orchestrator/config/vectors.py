"""The vectors that entries of the configuration list, one per load step."""

from __future__ import annotations

from orchestrator.config.bolts import Bolt
from orchestrator.config.boundary import Acting
from orchestrator.config.entry import Entry as Law

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
