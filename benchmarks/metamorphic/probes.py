"""Draw probes of a body, and read vectors from what a run tells of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from hypothesis import strategies as st

from benchmarks.metamorphic.layout import FACES, Body, rounded

VECTORS = ("u", "f", "m")  # displacement, force and moment


def probes(draw, found: list[Body], unit: float, words: set[str]) -> list[dict[str, Any]]:
    """A point of a body, the mean over a face of it and the force that it carries across a plane, some of these."""
    body = draw(st.sampled_from(found))
    at = rounded((body.low + np.array([draw(st.sampled_from([0.5, 0.3, 0.71])) for _ in "xyz"]) * body.size) * unit)
    normal = draw(st.sampled_from([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]))
    drawn = draw(st.lists(st.sampled_from([
        {"at": at}, {"section": {"plane": normal, "at": at}}, {"on": body.surface(draw(st.sampled_from(FACES))), "quantity": "mean"}]),
        min_size=1, max_size=3, unique_by=lambda probe: next(iter(probe))))
    words |= {f"probe {next(iter(probe))}" for probe in drawn}
    return [{"name": f"probe {k}", **probe, "part": body.name} for k, probe in enumerate(drawn)]


def vectors(told: list[Mapping[str, Any]]) -> dict[tuple[str, str], np.ndarray]:
    """(name, kind) → (T, 3) of what a summary tells, but for what it does not know."""
    return {(probe["name"], kind): np.array([probe["values"][kind + axis] for axis in "xyz"], float).T
            for probe in told for kind in VECTORS if probe["values"].get(kind + "x") is not None}
