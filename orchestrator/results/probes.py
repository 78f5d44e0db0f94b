"""Values that were asked for, at every load step: at points, over surfaces and across sections;
along lines, of which paths.csv has a line for each point and load step.

Tables of a run beside its fields, cell by cell as its files have them: the extremes of every
part, what interfaces carry, and what was probed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.method.delivery.balance import Resultants
from orchestrator.method.delivery.met import Met
from orchestrator.results.extremes import (
    COLUMNS, components_of_displacement, components_of_stress, DISPLACEMENT, NAME as EXTREMES,
    Nodal, RESULTANT, STRESS)
from orchestrator.results.folder import read_table
from orchestrator.scene.mesh.quadratic import tet_functions, TRIANGLE_SHARES
from orchestrator.scene.model import Scene


NAME, PATHS = "probes.csv", "paths.csv"
# columns of the latter
ALONG = ("path", "load_step", "distance", "x", "y", "z", *DISPLACEMENT, *STRESS)
FOREIGN = "the matter there is its code's own: what it is stressed by is not known here"
COMPONENTS = {"displacement": (DISPLACEMENT, components_of_displacement),
              "stress": (STRESS, components_of_stress)}


def at_points(quantity: str, cells: np.ndarray, weights: np.ndarray, nodal: Nodal) -> np.ndarray:
    """Return (T, n, 3 or 6) displacement or stress at points of tets, nan outside the body.

    cells : (n,) int, −1 outside; weights : (n, 4) barycentric coordinates there
    """
    fields, own = nodal.fields, cells >= 0
    if quantity == "stress":
        values, shape, at = map(nodal.stress, range(fields.steps)), weights, nodal.corner
    else:
        values, at = fields.displacement, fields.cells
        shape = np.array([tet_functions(w, at.shape[1]) for w in weights]).reshape(-1, at.shape[1])
    found = np.stack([np.einsum("na,nai->ni", shape[own], each[at[cells[own]]])
                      for each in values])
    result = np.full((len(found), len(cells), found.shape[2]), np.nan)
    result[:, own] = found
    return result


@dataclass(frozen=True)
class Reader:
    """Values that probes ask for.

    nodal : fields and stresses; carried : name of a probe that carries → (T, c) what it does
    """

    nodal: Nodal
    carried: Mapping[str, np.ndarray]

    def at(self, of: str, cells: np.ndarray,
           weights: np.ndarray) -> tuple[Sequence[str], np.ndarray]:
        """Return names of the components of displacement or stress, and (T, n, components) their
        values at points as of ``at_points``.
        """
        names, components = COMPONENTS[of]
        return names, components(at_points(of, cells, weights, self.nodal))

    def force(self, probe: Any) -> tuple:
        """Return force and moment about a point, (T, c)."""
        return RESULTANT, self.carried[probe.name]

    def over(self, probe: Any) -> tuple:
        """Return (T, components) the mean of each component over faces; or its extreme, and (T,
        components, 3) where these are.

        Means of stress are those of fields linear on each facet; of displacement, those of the
        element.
        """
        fields, stress = self.nodal.fields, probe.of == "stress"
        corners, (names, components) = (probe.corners[:, :3 if stress else None],
                                        COMPONENTS[probe.of])
        at = (self.nodal.corner if stress else fields.cells)[probe.cells[:, None], corners]
        each = np.stack([(self.nodal.stress(step) if stress else fields.displacement[step])[at]
                         for step in range(fields.steps)])
        if probe.quantity == "mean":
            share = np.linalg.norm(probe.area, axis=1) / probe.total
            return names, components(np.einsum("k,a,tkai->ti", share,
                                               TRIANGLE_SHARES[corners.shape[1]], each))
        each = components(each.reshape(len(each), at.size, each.shape[-1]))
        each[~np.isfinite(each).all(axis=(1, 2))] = np.nan
        # which find what is no number first
        place = (each.argmax if probe.quantity == "max" else each.argmin)(axis=1)
        points = fields.nodes[fields.cells[probe.cells[:, None], corners].ravel()]
        return names, np.take_along_axis(each, place[:, None], 1)[:, 0], points[place]


def read_probes(probes: Sequence[Any], reader: Reader) -> list[dict[str, object]]:
    """Per probe its name, what it tells, and per component the values of all load steps; of paths
    nothing.

    Returns dictionaries with ``name``, ``quantity``, ``of``, ``at`` (point, centre or per component
    and step the extreme's place), ``values`` (component → list per step) and, in place of numbers
    that would not be true, ``why``
    """
    return [_known(probe, *probe.told(reader)) for probe in probes if not probe.path]


def _known(probe: Any, names: Sequence[str], values: np.ndarray,
           places: np.ndarray | None = None) -> dict[str, object]:
    known, at = bool(np.isfinite(values).all()), probe.at
    if known and places is not None:
        at = dict(zip(names, places.swapaxes(0, 1).tolist()))
    told = {name: column if known else None for name, column in zip(names, values.T.tolist())}
    return {"name": probe.name, "quantity": probe.quantity, "of": probe.of, "at": at,
            "values": told} | ({} if known else {"why": FOREIGN})


def read_paths(probes: Sequence[Any], reader: Reader) -> list[dict[str, object]]:
    """Per path among probes ``name``, ``of``, ``distance`` (n,) from its first end, ``at`` (n, 3),
    and ``values``: component → (T, n), nan outside the body and where stresses are not to be
    believed.
    """
    return [{"name": probe.name, "of": probe.of, "distance": probe.distance, "at": probe.at,
             "values": dict(zip(names, np.moveaxis(values, 2, 0)))}
            for probe in probes if probe.path
            for names, values in [probe.told(reader)]]


def probe_columns(probes: Sequence[Mapping], steps: int) -> tuple[list[str], list[list]]:
    """Return the columns of probes.csv after the first: names and values of all load steps."""
    return ([f"{probe['name']}.{name}" for probe in probes for name in probe["values"]],
            [column or [None] * steps for probe in probes for column in probe["values"].values()])


def along_rows(paths: Sequence[Mapping]) -> Iterator[list[object]]:
    """Yield rows of paths.csv, with columns ``ALONG``; what a path does not tell is None."""
    for path in paths:
        columns = [path["values"].get(name) for name in ALONG[6:]]
        for step in range(len(next(iter(path["values"].values())))):
            for k, (distance, at) in enumerate(zip(path["distance"].tolist(), path["at"].tolist())):
                yield [path["name"], step + 1, distance, *at,
                       *(None if column is None else float(column[step, k]) for column in columns)]


Rows = list[list[str]]  # of texts, the head first
INTERFACES = "interfaces.csv"
OF_INTERFACES = (
    "interface", "side_1", "side_2", "law", "load_step", "fx", "fy", "fz", "mx", "my", "mz", "x",
    "y", "z", "pressure_x", "pressure_y", "pressure_z", "pressure_max", "area", "work",
    "dissipation")
# file → columns that it has at least
TABLES = {EXTREMES: COLUMNS, INTERFACES: OF_INTERFACES, NAME: ("load_step",), PATHS: ALONG}


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
        found[NAME] = table(("load_step", *names), zip(range(1, scene.steps + 1), *columns))
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
