"""What a run that was soon content guarantees, beside the answer of one that was not: its energy error, and its intervals."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress
from typing import Any

import numpy as np

from benchmarks.metamorphic.answers import Answer
from benchmarks.metamorphic.compare import LAWFUL, ROUNDING, distance, size_of


def claims_hold(fine: Answer, rough: Answer) -> tuple[str, str]:
    """Agree where the finer answer is within all that the rougher one guarantees, else disagree; not sayable where it guarantees nothing."""
    summary = rough.solution.summary
    if summary["error_kind"] != "guaranteed":
        return "not sayable", ""
    slack = ROUNDING if np.isfinite(fine.bound) else LAWFUL
    # interfaces that are springs store energy beside the bodies', which the bound is relative to as well
    larger = max(1.0, float(np.sqrt(2 * np.abs(fine.energy).max())) / size_of(fine))
    apart = distance(fine, rough).displacement
    outside = max(_outside(fine, summary["intervals"]), default=0.0) if summary["intervals"]["kind"] else 0.0
    wrong = apart > 1.001 * larger * summary["error_bound"] + slack or outside > slack
    return "disagree" if wrong else "agree", f"error {apart:.2e}, guaranteed {larger * summary['error_bound']:.2e}; outside intervals {outside:.1e}"


def _outside(fine: Answer, told: dict[str, Any]) -> Iterator[float]:
    """How far components of forces and displacements are out of their intervals, over the largest of their kind."""
    resultants, names = fine.solution.answers.interfaces.resultants.force, fine.solution.answers.interfaces.names
    forces = {name: resultants[:, k] for k, name in enumerate(names)}
    largest = max(np.abs(fine.reactions).max(initial=0.0), np.abs(resultants).max(initial=0.0)) or 1.0
    supports = [not entry.forces for entry in fine.solution.scene.boundary]
    between = [(one, forces[one["name"]]) for one in told["sections"] + told["resultants"]]
    for one, true in [*compress(zip(told["reactions"], fine.reactions), supports), *between]:
        yield _beyond(*(np.array(one[end], float) for end in ("low", "high")), true) / largest
    moved = max(np.abs(u).max() for u in fine.parts.values()) or 1.0
    for probe in told["probes"]:
        for kind, size in (("u", moved), ("f", largest)):
            if (probe["name"], kind) in fine.probes and kind + "x" in probe["values"]:
                low, high = (np.array([probe["values"][kind + axis][end] for axis in "xyz"], float).T for end in ("low", "high"))
                yield _beyond(low, high, fine.probes[probe["name"], kind]) / size


def _beyond(low: np.ndarray, high: np.ndarray, true: np.ndarray) -> float:
    return float(np.nanmax(np.maximum(low - true, true - high), initial=0.0))
