"""The numbers of a run that stand in a table of several: those of its summary, at the last load step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

AXES = ("x", "y", "z")


def numbers_of(summary: Mapping[str, object]) -> dict[str, float]:
    """Name → number; what is not known is left out. Forces of boundaries and bolts, probes and statuses are of the last load step."""
    found: dict[str, object] = {key: summary.get(key) for key in ("iterations", "error_bound", "discretisation_error")}
    found["seconds"] = (summary.get("timing") or {}).get("total")
    for key in ("peak_stress", "peak_displacement"):
        found[key] = (summary.get(key) or {}).get("value")
    found["energy"] = _last(summary.get("energy"))
    for name, steps in zip(summary.get("reaction_names") or (), summary.get("reactions") or ()):
        found |= {f"reaction.{name}.{axis}": value for axis, value in zip(AXES, _last(steps) or ())}
    bolts = summary.get("bolts") or ()
    if bolts and all(bolt["force"] for bolt in bolts):
        found |= {f"bolt_force_{end}": pick(bolt["force"][-1] for bolt in bolts) for end, pick in (("min", min), ("max", max))}
    for bolt in bolts:
        found |= {f"bolt.{bolt['name']}.{key}": _last(bolt[key]) for key in ("force", "shortening")}
    for probe in summary.get("probes") or ():
        found |= {f"{probe['name']}.{name}": _last(column) for name, column in probe["values"].items()}
    found |= {f"pairs.{name}": _last(counts) for name, counts in (summary.get("status_counts") or {}).items()}
    return {name: value for name, value in found.items() if isinstance(value, (int, float)) and math.isfinite(value)}


def _last(values: object) -> object:
    return values[-1] if isinstance(values, Sequence) and not isinstance(values, str) and len(values) else None
