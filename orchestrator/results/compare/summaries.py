"""Quantities of a results folder that are compared, of summary.json, the tables and the grids, and those that are told beside them.

Numbers of the solution are judged. How it was reached (iterations, bounds, residuals, statuses of node pairs, which flip where nothing
else does) is told; seconds, memory and versions are neither.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import meshio
import numpy as np

from orchestrator.errors import wrong
from orchestrator.results.answers import INTERFACES
from orchestrator.results.compare.quantities import ENERGY, FORCE, LENGTH, MOMENT, STRESS, Quantity
from orchestrator.results.extremes import DISPLACEMENT, NAME as EXTREMES, STRESS as STRESSES
from orchestrator.results.folder import DIRECTORY_KEY, read_table
from orchestrator.results.probes import NAME as PROBES, PATHS
from orchestrator.scene.mesh.geometry import format_point

FACTS = ("converged", "stop_reason", "load_steps", "dofs", "subdomains", "interfaces", "element", "reaction_names", "detached",
         "weakly_held")
OF_BOLTS = {"force": FORCE, "shear": FORCE, "bending": MOMENT, "torsion": MOMENT, "shortening": LENGTH}
TOLD = ("iterations", "error_bound", "error_kind", "tolerance", "status_counts", "warnings")
KIND_OF = {**dict.fromkeys(DISPLACEMENT, LENGTH), **dict.fromkeys(STRESSES, STRESS), **dict.fromkeys(("fx", "fy", "fz"), FORCE),
           **dict.fromkeys(("mx", "my", "mz"), MOMENT), "work": ENERGY, "dissipation": ENERGY, "pressure_max": STRESS,
           **dict.fromkeys(("displacement", "displacement_1", "displacement_2", "gap", "slip"), LENGTH), "joint_force": FORCE,
           **dict.fromkeys(("stress", "von_mises_max", "nodal_stress", "nodal_von_mises", "principal_stress", "pressure", "tension",
                            "friction_traction"), STRESS)}
LEFT_OUT = {"status", "shift_normal", "shift_tangential"}  # of grids: how exact a result is, and statuses, are no result
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

    Raises InputError: it cannot be read, or is not whole
    """
    keys, left_out = TABLES[name]
    rows = read_table(folder / name, keys)
    labels = [", ".join(row[key] if key != "load_step" else f"load step {row[key]}" for key in keys) for row in rows]
    order = np.argsort(labels, kind="stable")
    rows, labels = [rows[k] for k in order], [labels[k] for k in order]
    found = []
    for column in (c for c in (rows[0] if rows else ()) if c not in (*keys, *left_out)):
        try:
            numbers = np.array([float(row[column] or "nan") for row in rows])
        except ValueError as error:
            raise wrong(DIRECTORY_KEY, f"{folder / name} cannot be read: {error}", "a table that a run has written",
                        "run the configuration again") from error
        if name != EXTREMES:
            found.append(Quantity(f"{name}: {column}", KIND_OF.get(column.rpartition(".")[2], f"{name}: {column}"), numbers, labels.__getitem__))
            continue
        kinds = np.array([KIND_OF.get(label.split(", ")[-2], "") for label in labels])  # in as many as there are, rows of others unknown
        found += [Quantity(f"{name}: {kind}", str(kind) or name, np.where(kinds == kind, numbers, np.nan), labels.__getitem__)
                  for kind in np.unique(kinds)]
    return found, labels


def grids_of(folder: Path) -> list[str]:
    """The grids of a folder; those of several ranks are pieces, which are another number's."""
    return sorted(path.name for path in folder.glob("fields/*.vtu"))


def of_grid(folder: Path, name: str) -> tuple[list[Quantity], np.ndarray]:
    """Arrays of a grid, and its points (n, 3), whose places differences are told by; raises InputError: it cannot be read."""
    path = folder / "fields" / name
    try:
        grid = meshio.vtu.read(path)
    except Exception as error:  # noqa: BLE001 - of meshio's, whatever is wrong with the file
        raise wrong(DIRECTORY_KEY, f"{path} cannot be read: {error}", "a file of a results folder",
                    "run the configuration again") from error
    return list(_arrays(grid, path.name.removesuffix(".vtu"))), grid.points


def _arrays(grid: meshio.Mesh, file: str) -> Iterator[Quantity]:
    points = grid.points
    yield Quantity("nodes", "place", points, lambda i: file)
    for block in grid.cells:
        yield Quantity("cells", "cells", block.data, lambda i: file)
    for name, values in grid.point_data.items():
        if name not in LEFT_OUT:
            yield Quantity(name, KIND_OF.get(name, name), values, lambda i: f"{file}, at {format_point(points[i])}")
    for name, blocks in grid.cell_data.items():
        for values, block in zip(blocks, grid.cells):
            yield Quantity(name, KIND_OF.get(name, name), values,
                           lambda i, block=block: f"{file}, around {format_point(points[block.data[i]].mean(axis=0))}")
