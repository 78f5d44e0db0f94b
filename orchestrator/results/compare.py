"""``orchestrator compare``: two runs side by side, and whether they are equal.

A number of one run may differ from the other's by the sum of both errors, relative to the largest
number of its kind (forces, lengths, stresses, energies) in both runs. An error is the run's energy
error, or where it knows none its law residual; between runs on different meshes the estimated
errors of the meshes are added. Rounding is always let through.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.results.fields.fields import read_npz
from orchestrator.results.summary.summary import quantities, read_summary, View
from orchestrator.linalg import PLACED
from orchestrator.scene.inspection import columns

FACTS = ("converged", "stop_reason", "load_steps")
SHOWN = ("iterations", "error_bound", "discretisation_error")


@dataclass(frozen=True)
class Row:
    """One quantity in both runs; ``allowed`` is None where it is shown and not judged."""

    name: str
    both: Sequence[str]
    difference: float = 0.0
    allowed: float | None = None

    @property
    def differs(self) -> bool:
        return self.allowed is not None and not self.difference <= self.allowed

    @property
    def cells(self) -> tuple[str, ...]:
        judged = ("-", "-", "") if self.allowed is None else (
            f"{self.difference:.1e}", f"{self.allowed:.1e}", "DIFFERENT" * self.differs)
        return self.name, *self.both, *judged


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
        heads = "quantity", "A", "B", "difference", "allowed", ""
        return [*columns(heads, [row.cells for row in self.rows]), "",
                f"DIFFERENT: {bad} of {judged} quantities" if bad
                else f"equal: {judged} quantities, to within the errors told"]


def compare(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> Comparison:
    """Compare two results folders.

    Raises InputError: one of them is none, or a file in it cannot be read
    """
    views = [View(read_summary(path)) for path in (one, other)]
    meshes = [read_npz(path) for path in (one, other)]
    if all(meshes):
        here, there = (mesh.nodes for mesh in meshes)
        same = here.shape == there.shape and np.allclose(here, there)
    else:
        same = all(getattr(views[0], key) == getattr(views[1], key) for key in ("dofs", "element"))
    found = [_numbers(view) for view in views]
    if same and all(meshes):
        for numbers, fields in zip(found, meshes):
            numbers["displacement field"] = "length", fields.displacement
    scales: dict[str, float] = {}
    for kind, values in (entry for numbers in found for entry in numbers.values()):
        scales[kind] = max(scales.get(kind, 0.0), float(np.abs(values).max(initial=0.0)))
    pairs = [(name, [getattr(view, name) for view in views]) for name in FACTS]
    rows = [Row(name, list(map(str, pair)), float(pair[0] != pair[1]), 0.0)
            for name, pair in pairs if pair != [None, None]]
    allowed = max(PLACED, sum(_error(view, same) for view in views))
    for name in found[0] | found[1]:
        both = [numbers.get(name, ("", None)) for numbers in found]
        kind, values = max(both[0][0], both[1][0]), [entry[1] for entry in both]
        rows.append(_row(name, *values, scales[kind], allowed))
    return Comparison(rows + _shown(*views))


def _error(s: View, same: bool) -> float:
    """Return the relative error of a run, with its mesh's unless both have the ``same``."""
    known = s.residuals.get("law_residual") if s.error_bound is None else s.error_bound
    return (known or 0.0) + (0.0 if same else s.discretisation_error or 0.0)


def _numbers(s: View) -> dict[str, tuple[str, np.ndarray]]:
    """Return name → kind and numbers, nan where they are not known."""
    found = {name: (kind, values) for _, name, kind, values in quantities(s)
             if name and values is not None}
    for face in s.contact_faces:
        if slips := face["slips"]:
            found[f"slips at load step: {face['name']}"] = "load step", slips["step"]
            if slips["at"] is not None:
                found[f"slip load of {face['name']}"] = slips["of"], slips["at"]
    found |= {f"limit load, share of load step {limit['load_step']}": ("share", limit["factor"])
              for limit in s.limit_load if limit["factor"] is not None}
    return {name: (kind, np.array(values, float)) for name, (kind, values) in found.items()}


def _row(name: str, one: np.ndarray | None, other: np.ndarray | None, scale: float,
         allowed: float) -> Row:
    """Return the numbers where they differ too much, or are largest; what one run lacks differs."""
    if one is None or other is None or one.shape != other.shape:
        told = ["-" if x is None else f"{x.shape or 1} numbers" for x in (one, other)]
        return Row(name, told, np.inf, allowed)
    unknown = np.isnan(one) & np.isnan(other)
    gap = np.where(unknown, 0.0, np.nan_to_num(np.abs(one - other), nan=np.inf)) / (scale or 1.0)
    most = float(gap.max(initial=0.0))
    worst = int(np.argmax(gap if most > allowed else np.abs(np.nan_to_num(one))))
    step, *others = np.unravel_index(worst, one.shape) or (0,)
    name += (f", load step {step + 1}" if one.ndim else "") + (
        f", {'xyz'[others[-1]]}" if others else "")
    return Row(name, [f"{x.flat[worst]:.6g}" for x in (one, other)], most, allowed)


def _shown(*views: View) -> list[Row]:
    """Return rows that are not judged: statuses of nodes flip where nothing else does."""
    pairs = {key.replace("_", " "): [getattr(s, key) for s in views] for key in SHOWN}
    pairs |= {f"nodes that are {name}, last load step": [
        s.status_counts.get(name, [None])[-1] for s in views]
        for name in views[0].status_counts | views[1].status_counts}
    return [Row(name, ["-" if x is None else f"{x:.3g}" if isinstance(x, float) else str(x)
                       for x in values])
            for name, values in pairs.items() if values != [None, None]]
