"""Tables of a run beside its fields, cell by cell as its files have them: the extremes of every
part, what interfaces carry, and what was probed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.met import Met
from orchestrator.results.extremes import COLUMNS, NAME as EXTREMES
from orchestrator.results.folder import read_table
from orchestrator.results.probes import ALONG, NAME as PROBES, PATHS, along_rows, probe_columns
from orchestrator.scene.model import Scene

Rows = list[list[str]]  # of texts, the head first
INTERFACES = "interfaces.csv"
OF_INTERFACES = (
    "interface", "side_1", "side_2", "law", "load_step", "fx", "fy", "fz", "mx", "my", "mz", "x",
    "y", "z", "pressure_x", "pressure_y", "pressure_z", "pressure_max", "area", "work",
    "dissipation")
# file → columns that it has at least
TABLES = {EXTREMES: COLUMNS, INTERFACES: OF_INTERFACES, PROBES: ("load_step",), PATHS: ALONG}


def tables_of(scene: Scene, resultants: Resultants, met: Met | None, extremes: Iterable[tuple],
              probes: Sequence[dict], paths: Sequence[dict]) -> dict[str, Rows]:
    """Return file → table of a solved scene, those that tell something; ``extremes``, ``probes``
    and ``paths`` as their modules have them.
    """
    found = {EXTREMES: table(COLUMNS, extremes, ".9g")}
    if scene.interfaces:
        found[INTERFACES] = interface_table(scene, resultants, met)
    if probes:
        names, columns = probe_columns(probes, scene.steps)
        found[PROBES] = table(("load_step", *names), zip(range(1, scene.steps + 1), *columns))
    if paths:
        found[PATHS] = table(ALONG, along_rows(paths))
    return found


def interface_table(scene: Scene, resultants: Resultants, met: Met | None) -> Rows:
    """Return the table of all interfaces: forces and moments on side 1, where they act, the largest
    pressure at a node (none of bonded interfaces, where stresses tell), area, and work and
    dissipation since the unloaded state, see ``delivery.met``.
    """
    r, shape = resultants, (scene.steps, len(scene.interfaces), 1)
    pressure, work, lost = np.full(shape, np.nan), np.zeros(shape), np.zeros(shape)
    if met is not None:
        for into, values in ((pressure, met.pressure), (work, met.work), (lost, met.dissipation)):
            into[:, [i.index for i in scene.opening], 0] = values.T
    area = np.broadcast_to(r.area[:, None], shape)
    numbers = np.concatenate([r.force, r.moment, np.broadcast_to(r.centre, r.force.shape),
                              r.pressure_centre, pressure, area, work, lost], axis=2)
    return table(OF_INTERFACES, (
        [i.name, *(scene.subdomains[e].name for e in i.subdomains), i.law.name, step, *row]
        for k, i in enumerate(scene.interfaces)
        for step, row in enumerate(numbers[:, k].tolist(), 1)), ".12g")


def table(head: Sequence[str], rows: Iterable[Sequence[object]], form: str = "") -> Rows:
    """Return texts of cells, empty where nothing is known; ``form``: of floats."""
    return [list(head), *([
        "" if x is None or x != x else format(x, form) if isinstance(x, float) else str(x)
        for x in row] for row in rows)]


def read_tables(directory: Path) -> dict[str, Rows]:
    """Return the tables of a results folder; raises InputError: one cannot be read, or is not
    whole.
    """
    found = {name: read_table(directory / name, columns) for name, columns in TABLES.items()}
    return {name: rows for name, rows in found.items() if rows}
