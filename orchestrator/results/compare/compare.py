"""Compares two results folders: summary, tables, fields."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from orchestrator.results.compare.quantities import Difference, Quantity, Scales, apart, numbers_differ
from orchestrator.results.compare.summaries import FACTS, TABLES, TOLD, grids_of, of_grid, of_summary, of_table
from orchestrator.results.fingerprint import differences, problem_of
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.summary.summary import read_summary

TOLERANCE = 1e-9  # relative; results of one configuration on another machine agree to 1e-12 bonded, and to the tolerance with contact
SHOWN, TOLD_SHOWN = 10, 4  # lines on screen
TABLE = "compare.csv"


@dataclass(frozen=True)
class Comparison:
    """Two folders beside each other.

    found : by name, of all that is judged, the largest first
    told : sentences on what is not judged
    tolerance : by how much numbers may differ, relative, see ``quantities``
    """

    found: list[Difference]
    told: list[str]
    tolerance: float

    @property
    def beyond(self) -> list[Difference]:
        """The differences beyond what is allowed."""
        return [d for d in self.found if not d.share <= self.tolerance]

    def lines(self) -> list[str]:
        """Lines for the screen."""
        beyond = self.beyond
        rows = [f"  {d.name}: {d.text or f'{d.of_largest:.1e} of the largest, {d.share:.1e} of the number itself'}"
                + (f"  ({d.where})" if d.where else "") for d in beyond[:SHOWN]]
        more = [f"  … and {len(beyond) - SHOWN} more"] * (len(beyond) > SHOWN)
        head = [f"not alike, by more than {self.tolerance:g}:"] * bool(beyond)
        largest = max((d.share for d in self.found), default=0.0)
        end = (f"DIFFERENT: {len(beyond)} of {len(self.found)} quantities" if beyond else
               f"alike: {len(self.found)} quantities within {self.tolerance:g}, the largest difference is {largest:.1e}")
        return [*head, *rows, *more, *self.told, end]

    def write(self, folder: ResultsFolder) -> Path:
        """Writes compare.csv, a line for each quantity."""
        return folder.write_table(TABLE, [["quantity", "relative", "of_largest", "alike", "where", "text"], *(
            [d.name, repr(d.share), repr(d.of_largest), int(d.share <= self.tolerance), d.where, d.text] for d in self.found)])


def compare(one: str | os.PathLike[str], other: str | os.PathLike[str], tolerance: float = TOLERANCE) -> Comparison:
    """Two results folders.

    Raises InputError: one of them is none, or a file in it cannot be read
    """
    paths = Path(one), Path(other)
    summaries = [read_summary(path) for path in paths]
    scales, names = Scales(), [grids_of(path) for path in paths]
    for path, summary, grids in zip(paths, summaries, names):
        scales.take([*of_summary(summary), *(q for table in TABLES for q in of_table(path, table)[0])])
        for name in grids:
            quantities, points = of_grid(path, name)
            scales.take(quantities)
            scales.size = max(scales.size, float(np.ptp(points, axis=0).max(initial=0.0)) if len(points) else 0.0)
    found = []
    for name in FACTS:
        here, there = (summary.get(name) for summary in summaries)
        found.append(Difference(name, 0.0) if here == there else apart(name, f"{here}, {there} there"))
    found += _against(list(of_summary(summaries[0])), list(of_summary(summaries[1])), scales)
    for table in TABLES:
        (first, rows), (second, others) = (of_table(path, table) for path in paths)
        if rows != others:
            lost = next(iter(sorted(set(rows) ^ set(others))), "")
            found.append(apart(table, f"{len(rows)} rows, {len(others)} there" + (f", such as {lost}" if lost else "")))
        else:
            found += _against(first, second, scales)
    found += _grids(paths, names, scales)
    worst: dict[str, Difference] = {}
    for d in found:
        known = worst.get(d.name, d)
        worst[d.name] = replace(max(known, d, key=lambda x: x.of_largest), share=max(known.share, d.share))
    return Comparison(sorted(worst.values(), key=lambda d: -d.of_largest), _told(*summaries), tolerance)


def _against(one: list[Quantity], other: list[Quantity], scales: Scales) -> list[Difference]:
    """Quantities of the same names, which may be there several times; what only one side has differs."""
    found, there = [], {}
    for q in other:
        there.setdefault(q.name, []).append(q)
    for q in one:
        mate = there.get(q.name)
        found.append(numbers_differ(q, mate.pop(0), scales) if mate else apart(q.name, "not there"))
    return found + [apart(name, "only there") for name, left in there.items() if left]


def _grids(paths: tuple[Path, Path], names: list[list[str]], scales: Scales) -> list[Difference]:
    only = sorted(set(names[0]) ^ set(names[1]))
    if only:
        return [apart("fields/", f"{len(names[0])} files, {len(names[1])} there, such as {only[0]}: of other load steps, or pieces of another "
                      "number of ranks")]
    found = []
    for name in names[0]:
        (first, _), (second, _) = (of_grid(path, name) for path in paths)
        shapes = [[q.values.shape for q in quantities if q.name in ("nodes", "cells")] for quantities in (first, second)]
        if shapes[0] != shapes[1]:
            found.append(apart("nodes", f"{shapes[0][0][0]:,}, {shapes[1][0][0]:,} there: another mesh, fields are not compared", name))
        else:
            found += _against(first, second, scales)
    return found


def _told(one: dict[str, object], other: dict[str, object]) -> list[str]:
    """Notes that are not judged: the configuration, and how the solution was reached."""
    configs = [{key: value for key, value in (summary.get("config") or {}).items() if key not in ("name", "output")}
               for summary in (one, other)]
    changed = differences(*map(problem_of, configs))
    rows = [f"configuration: {text}" for text in changed[:TOLD_SHOWN]]
    rows += [f"configuration: … and {len(changed) - TOLD_SHOWN} more"] * (len(changed) > TOLD_SHOWN)
    reached = [f"{name} {_short(one.get(name))}, {_short(other.get(name))} there" for name in TOLD if one.get(name) != other.get(name)]
    return rows + (["not judged: " + "; ".join(reached)] if reached else [])


def _short(value: object) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{name} {counts[-1]}" for name, counts in value.items() if any(counts)) + ")"
    if isinstance(value, list):
        return f"{len(value)} of them"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
