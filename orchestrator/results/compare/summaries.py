"""Quantities of summary.json and of the tables that are compared, and those that are told beside them.

Numbers of the solution are judged. How it was reached (iterations, bounds, residuals, statuses of node pairs, which flip where nothing
else does) is told; seconds, memory and versions are neither.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from orchestrator.errors import wrong
from orchestrator.results.answers import INTERFACES
from orchestrator.results.compare.quantities import ENERGY, FORCE, LENGTH, MOMENT, STRESS, Quantity
from orchestrator.results.extremes import DISPLACEMENT, NAME as EXTREMES, STRESS as STRESSES
from orchestrator.results.folder import DIRECTORY_KEY
from orchestrator.results.paths import NAME as PATHS
from orchestrator.results.probes import NAME as PROBES

FACTS = ("converged", "stop_reason", "load_steps", "dofs", "subdomains", "interfaces", "element", "reaction_names", "detached",
         "weakly_held")
OF_BOLTS = {"force": FORCE, "shear": FORCE, "bending": MOMENT, "torsion": MOMENT, "shortening": LENGTH}
TOLD = ("iterations", "error_bound", "error_kind", "tolerance", "status_counts", "warnings")
KIND_OF = {**dict.fromkeys(DISPLACEMENT, LENGTH), **dict.fromkeys(STRESSES, STRESS), **dict.fromkeys(("fx", "fy", "fz"), FORCE),
           **dict.fromkeys(("mx", "my", "mz"), MOMENT), "work": ENERGY, "dissipation": ENERGY, "pressure_max": STRESS}
# table → columns that name a row, columns that are no result: of extremes that are alike at several places any place may be told
TABLES = {EXTREMES: (("part", "quantity", "extreme"), ("x", "y", "z", "load_step")),
          INTERFACES: (("interface", "side_1", "side_2", "law", "load_step"), ("pressure_x", "pressure_y", "pressure_z")),
          PROBES: (("load_step",), ()), PATHS: (("path", "load_step", "distance"), ())}


def of_summary(summary: Mapping[str, object]) -> Iterator[Quantity]:
    """Numbers of the solution that a summary has."""
    yield from _known("energy", ENERGY, summary.get("energy"), _step)
    yield from _known("peak_stress", STRESS, (summary.get("peak_stress") or {}).get("value"))
    yield from _known("peak_displacement", LENGTH, (summary.get("peak_displacement") or {}).get("value"))
    yield from _known("discretisation_error", "", summary.get("discretisation_error"))
    names = summary.get("reaction_names") or []
    for key, kind, values in (("reactions", FORCE, summary.get("reactions")),
                              ("reaction_moments", MOMENT, (summary.get("reaction_moments") or {}).get("moments"))):
        yield from _known(key, kind, values, lambda i: str(names[i]) if i < len(names) else "")
    for bolt in summary.get("bolts") or ():
        for key, kind in OF_BOLTS.items():
            yield from _known(f"bolt {bolt['name']}: {key}", kind, bolt.get(key), _step)
    for one in summary.get("interface_resultants") or ():
        yield from _known(f"resultant of {one['name']}", FORCE, one["resultant"], _step)


def _known(name: str, kind: str, values: object, where=lambda index: "") -> Iterator[Quantity]:
    if values is not None:
        yield Quantity(name, kind or name, np.array(values, float), where)


def _step(index: int) -> str:
    return f"load step {index + 1}"


def of_table(folder: Path, name: str) -> tuple[list[Quantity], list[str]]:
    """The columns of a table, and what names its rows, in their order; nothing where there is none.

    Raises InputError: it cannot be read, or lacks the columns that name its rows
    """
    path, (keys, left_out) = folder / name, TABLES[name]
    if not path.is_file():
        return [], []
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        if rows and not set(keys) <= set(rows[0]):
            raise ValueError(f"no columns {', '.join(keys)}")
        labels = [", ".join(row[key] if key != "load_step" else f"load step {row[key]}" for key in keys) for row in rows]
        order = np.argsort(labels, kind="stable")
        rows, labels = [rows[k] for k in order], [labels[k] for k in order]
        columns = [column for column in (rows[0] if rows else ()) if column not in (*keys, *left_out)]
        values = {column: np.array([float(row[column] or "nan") for row in rows]) for column in columns}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}", "a table that a run has written",
                    "run the configuration again") from error
    return [q for column, numbers in values.items() for q in _column(name, column, numbers, labels)], labels


def _column(table: str, column: str, numbers: np.ndarray, labels: list[str]) -> Iterator[Quantity]:
    """A column; that of extremes in as many as there are kinds, rows of other kinds unknown."""
    if table != EXTREMES:
        yield Quantity(f"{table}: {column}", KIND_OF.get(column.rpartition(".")[2], f"{table}: {column}"), numbers, labels.__getitem__)
        return
    kinds = np.array([KIND_OF.get(label.split(", ")[-2], "") for label in labels])
    for kind in np.unique(kinds):
        yield Quantity(f"{table}: {kind}", str(kind) or table, np.where(kinds == kind, numbers, np.nan), labels.__getitem__)
