"""Load steps: how many there are, and what every entry amounts to at each of them."""

from __future__ import annotations

from orchestrator.config.bolts import Bolt
from orchestrator.config.boundary import BodyForce, BoundaryCondition
from orchestrator.config.entry import Entry as Law
from orchestrator.config.model import Config

Entry = BoundaryCondition | BodyForce | Bolt | Law


def vector_of(entry: Entry) -> list | None:
    """The entry's vector, or list of vectors; a uniform pressure is the vector (p, 0, 0). None: a field, see ``factors``."""
    if isinstance(entry, BodyForce):
        return entry.body_force
    if not isinstance(entry, BoundaryCondition):
        listed = [getattr(entry, key) for key in getattr(entry, "per_step", ())]
        return next(filter(is_per_step, listed), None)
    if entry.symmetry or entry.foundation or entry.coupling:
        return None
    if isinstance(entry.pressure, float | int):
        return [entry.pressure, 0.0, 0.0]
    return entry.displacement if entry.displacement is not None else entry.traction


def is_per_step(vector: list) -> bool:
    """Whether a value lists one vector per load step."""
    return isinstance(vector[0], list)


def steps(config: Config) -> int:
    """Number of load steps: the length of the histories in use and of the per-step lists; else 1."""
    for entry in (*config.boundary, *config.loads, *config.interfaces, *config.bolts):
        if entry.history is not None:
            return len(config.histories[entry.history])
        if (vector := vector_of(entry)) is not None and is_per_step(vector):
            return len(vector)
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


def vectors_per_step(entry: Entry, config: Config) -> list[list[float | None]] | None:
    """Values of a boundary condition or body force at every load step.

    Parameters
    ----------
    entry : of ``config.boundary`` or ``config.loads``
    config : gives the histories and the number of steps

    Returns
    -------
    (steps, 3) numbers in the YAML's units, None for free components. A history multiplies the
    vector; without one the vector is the same at every step. Pressures are in column 0.
    None where the entry is a field
    """
    vector = vector_of(entry)
    if vector is None:
        return None
    if is_per_step(vector):
        return [[_number(value, 1.0) for value in row] for row in vector]
    return [[_number(value, factor) for value in vector] for factor in factors(entry, config)]


def _number(value: float | None, factor: float) -> float | None:
    return None if value is None else float(value) * factor
