"""Load steps: how many there are, and what multiplies every entry at each of them."""

from __future__ import annotations

from orchestrator.config.model import Config
from orchestrator.config.vectors import Entry


def steps(config: Config) -> int:
    """Number of load steps: the length of the histories in use and of the per-step lists; else 1."""
    return config.steps


def factors(entry: Entry, config: Config) -> list[float]:
    """What multiplies the entry at every load step."""
    return config.factors_of(entry.history)
