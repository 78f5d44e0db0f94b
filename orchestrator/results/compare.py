"""``orchestrator compare``: two runs side by side, and whether they are equal.

A number of one run may differ from the other's by the sum of both errors, relative to the largest
number of its kind (forces, lengths, stresses, energies) in both runs. An error is the run's energy
error, or where it knows none its law residual; between runs on different meshes the estimated
errors of the meshes are added. Rounding is always let through.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.results.fields.npz import read_npz
from orchestrator.results.summary.summary import read_summary
from orchestrator.scene.inspection import columns

ROUNDING = 1e-9  # relative; another number of ranks adds in another order
FACTS = ("converged", "stop_reason", "load_steps")
KINDS = {"displacement": "length", "stress": "stress", "force": "force"}


@dataclass(frozen=True)
class Row:
    """One quantity in both runs; ``allowed`` is None where it is shown and not judged."""

    name: str
    one: str
    other: str
    difference: float = 0.0
    allowed: float | None = None

    @property
    def differs(self) -> bool:
        return self.allowed is not None and not self.difference <= self.allowed

    @property
    def cells(self) -> tuple[str, ...]:
        judged = (
            ("-", "-", "")
            if self.allowed is None
            else (f"{self.difference:.1e}", f"{self.allowed:.1e}", "DIFFERENT" * self.differs)
        )
        return self.name, self.one, self.other, *judged


@dataclass(frozen=True)
class Comparison:
    """Rows of the table: what is judged, then what is shown only."""

    rows: list[Row]

    @property
    def different(self) -> list[str]:
        """Names of the quantities that differ by more than the errors."""
        return [row.name for row in self.rows if row.differs]

    def lines(self) -> list[str]:
        """Return the table as text, and the verdict."""
        judged, bad = sum(row.allowed is not None for row in self.rows), len(self.different)
        verdict = (
            f"DIFFERENT: {bad} of {judged} quantities"
            if bad
            else f"equal: {judged} quantities, to within the errors told"
        )
        return [
            *columns(
                ("quantity", "A", "B", "difference", "allowed", ""),
                [row.cells for row in self.rows],
            ),
            "",
            verdict,
        ]


def compare(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> Comparison:
    """Compare two results folders.

    Raises InputError: one of them is none, or a file in it cannot be read
    """
    paths = Path(one), Path(other)
    summaries, (here, there) = (
        [read_summary(path) for path in paths],
        (read_npz(path) for path in paths),
    )
    same = (
        here.nodes.shape == there.nodes.shape and np.allclose(here.nodes, there.nodes)
        if here and there
        else all(summaries[0].get(key) == summaries[1].get(key) for key in ("dofs", "element"))
    )
    allowed = max(ROUNDING, sum(_error(summary, same) for summary in summaries))
    found = [
        {name: (kind, np.array(values, float)) for name, kind, values in _numbers(summary)}
        for summary in summaries
    ]
    if same and here and there:
        for run, fields in zip(found, (here, there)):
            run["displacement field"] = "length", fields.displacement
    scales: dict[str, float] = {}
    for kind, values in (entry for run in found for entry in run.values()):
        scales[kind] = max(scales.get(kind, 0.0), float(np.abs(values).max(initial=0.0)))
    rows = [
        Row(name, *map(str, pair), float(pair[0] != pair[1]), 0.0)
        for name in FACTS
        if (pair := [summary.get(name) for summary in summaries]) != [None, None]
    ]
    for name in dict.fromkeys([*found[0], *found[1]]):
        kind = next(run[name][0] for run in found if name in run)
        rows.append(
            _row(
                name,
                *(run[name][1] if name in run else None for run in found),
                scales[kind],
                allowed,
            )
        )
    return Comparison(rows + _shown(*summaries))


def _error(summary: Mapping[str, Any], same: bool) -> float:
    """Return the relative error of a run, with its mesh's unless both have the ``same``."""
    known = summary.get("error_bound")
    of_iterations = (
        known if known is not None else (summary.get("residuals") or {}).get("law_residual")
    )
    return (of_iterations or 0.0) + (0.0 if same else summary.get("discretisation_error") or 0.0)


def _numbers(summary: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield name, kind and numbers of what an engineer asks a run for."""
    for key, kind in (("peak_stress", "stress"), ("peak_displacement", "length")):
        if (peak := summary.get(key)) and peak.get("value") is not None:
            yield key.replace("_", " "), kind, peak["value"]
    if summary.get("energy"):
        yield "energy", "energy", summary["energy"]
    for name, values in zip(summary.get("reaction_names") or (), summary.get("reactions") or ()):
        yield f"reaction {name}", "force", values
    for bolt in summary.get("bolts") or ():
        yield f"bolt {bolt['name']}, axial", "force", bolt["force"]
    for face in summary.get("contact_faces") or ():
        if slips := face["slips"]:
            yield f"slips at load step: {face['name']}", "load step", slips["step"]
            if slips["at"] is not None:
                yield f"slip load of {face['name']}", slips["of"], slips["at"]
    for limit in summary.get("limit_load") or ():
        if limit["factor"] is not None:
            yield f"limit load, share of load step {limit['load_step']}", "share", limit["factor"]
    for probe in summary.get("probes") or ():
        for name, values in probe["values"].items():
            kind = "moment" if name in ("mx", "my", "mz") else KINDS.get(probe.get("of"), name)
            yield (
                f"probe {probe['name']} {name}",
                kind,
                [np.nan if value is None else value for value in values],
            )


def _row(
    name: str, one: np.ndarray | None, other: np.ndarray | None, scale: float, allowed: float
) -> Row:
    """Return the numbers where they differ too much, or are largest; what one run lacks differs."""
    if one is None or other is None or one.shape != other.shape:
        told = [
            "-" if values is None else f"{values.shape or 1} numbers" for values in (one, other)
        ]
        return Row(name, *told, np.inf, allowed)
    unknown = np.isnan(one) & np.isnan(other)
    gap = np.where(unknown, 0.0, np.nan_to_num(np.abs(one - other), nan=np.inf)) / (scale or 1.0)
    worst = int(np.argmax(gap if gap.max(initial=0.0) > allowed else np.abs(np.nan_to_num(one))))
    step, *others = np.unravel_index(worst, one.shape) or (0,)
    name += (f", load step {step + 1}" if one.ndim else "") + (
        f", {'xyz'[others[-1]]}" if others else ""
    )
    return Row(
        name,
        f"{one.flat[worst]:.6g}",
        f"{other.flat[worst]:.6g}",
        float(gap.max(initial=0.0)),
        allowed,
    )


def _shown(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[Row]:
    """Return rows that are not judged: statuses of nodes flip where nothing else does."""
    pairs = [
        (key.replace("_", " "), one.get(key), other.get(key))
        for key in ("iterations", "error_bound", "discretisation_error")
    ]
    counts = [summary.get("status_counts") or {} for summary in (one, other)]
    pairs += [
        (
            f"nodes that are {name}, last load step",
            *((count.get(name) or [None])[-1] for count in counts),
        )
        for name in dict.fromkeys([*counts[0], *counts[1]])
    ]
    return [
        Row(
            name,
            *(
                "-" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
                for value in values
            ),
        )
        for name, *values in pairs
        if values != [None, None]
    ]
