"""Intervals that contain true values, in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orchestrator.errors import some
from orchestrator.results.summary.summary import units_of

SHOWN = 12  # on screen


def sentences(summary: Mapping[str, object]) -> list[str]:
    """Sentences on what is certified at the last load step."""
    found, units = summary.get("intervals"), units_of(summary)
    if not found or not found["kind"]:
        return [str(found["why"])] if found else []
    texts, lost = [], {}
    for probe in found["probes"]:
        if why := probe.get("why"):
            lost.setdefault(why, []).append(probe["name"])
        kind, _, how = probe["of"].partition(", ")
        rows: dict[str, list[str]] = {}
        for name, ends in probe["values"].items():
            unit = {"displacement": "length", "force": "moment" if name[0] == "m" else "force"}.get(kind, kind)
            rows.setdefault(units[unit], []).append(_between(name, ends["low"][-1], ends["high"][-1]))
        texts.append(f"{probe['name']}{how and f' ({how})'}: {'; '.join(', '.join(row) + unit for unit, row in rows.items())}")
    for key in ("reactions", "sections", "resultants", "bolts"):
        for one in found.get(key) or ():
            if why := one.get("why"):
                lost.setdefault(why, []).append(one["name"])
                continue
            text = f"{one['name']}: {_row('f', one)}{units['force']}"
            texts.append(text + (f"; {_row('m', one['moment'])}{units['moment']}" if "moment" in one and "why" not in one["moment"] else ""))
    more = [f"… and {len(texts) - SHOWN} more in summary.json"] * (len(texts) > SHOWN)
    lost = [f"{some(names)}: {why}" for why, names in lost.items()]
    return [f"{found['kind']}, of the solution of this mesh:", *texts[:SHOWN], *more, *lost]


def _row(letter: str, ends: Mapping[str, object]) -> str:
    """Components of a vector, or a number."""
    low, high = (np.atleast_1d(ends[end][-1]) for end in ("low", "high"))
    names = [letter + axis for axis in "xyz"] if len(low) == 3 else ["force"]
    return ", ".join(_between(*each) for each in zip(names, low, high))


def _between(name: str, low: float | None, high: float | None) -> str:
    """Both ends, with as many digits as they differ in, and two."""
    if low is None or high is None:
        return f"{name} {'–' if low is None else f'{low:.6g}'} … {'–' if high is None else f'{high:.6g}'}"
    width, size = high - low, max(abs(low), abs(high))
    digits = int(np.clip(np.ceil(np.log10(size / width)) + 2, 2, 12)) if width > 0 else 6
    return f"{name} {low:.{digits}g} … {high:.{digits}g}"
