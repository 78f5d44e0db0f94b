"""Values that were asked for, at every load step: at points, over surfaces and across sections; along lines, of which paths.csv has a line
for each point and load step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.method.delivery.flux import FORCES, cells_of, flux
from orchestrator.parallel.team import ALONE, Team
from orchestrator.results.extremes import DISPLACEMENT, RESULTANT, STRESS, components_of_displacement, components_of_stress
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.nodal import Nodal
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.conditions.probes import Line, Point, Section, Surface
from orchestrator.scene.copies import Copies
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions
from orchestrator.scene.model import Scene

NAME, PATHS = "probes.csv", "paths.csv"
ALONG = ("path", "load_step", "distance", "x", "y", "z", *DISPLACEMENT, *STRESS)  # columns of the latter
FOREIGN = "the matter there is its code's own: what it is stressed by is not known here"


@dataclass(frozen=True)
class Reader:
    """Reads values at points, of the whole or, by all ranks together, of their pieces of it.

    nodal : of the fields; number : (m,) int, ascending, of their tets in the whole; None: they are the whole
    """

    nodal: Nodal
    number: np.ndarray | None = None
    team: Team = ALONE

    def __call__(self, probe: Point | Line) -> tuple[Sequence[str], np.ndarray | None]:
        """Names of the components of displacement or stress, and (T, n, components) their values, nan outside the body; on rank 0."""
        cells, weights = (probe.cells, probe.weights) if isinstance(probe, Line) else (np.array([probe.cell]), probe.weights[None])
        own = np.flatnonzero(cells >= 0 if self.number is None else np.isin(cells, self.number))
        at = cells[own] if self.number is None else np.searchsorted(self.number, cells[own])
        names, found = at_points(probe.quantity, at, weights[own], self.nodal)
        told = self.team.gather((own, found))
        if told is None:
            return names, None
        values = np.full((len(found), len(cells), len(names)), np.nan)
        for there, of_rank in told:
            values[:, there] = of_rank
        return names, values


def read_probes(scene: Scene, read: Reader, parts: Sequence[np.ndarray], rims: Mapping[str, np.ndarray]) -> list[dict[str, object]]:
    """Per probe of the scene its name, what it tells, and per component the values of all load steps.

    parts : per subdomain (T, n_E, 3), in equilibrium with its interface forces
    rims : name → (T, 6) what others do at a resultant's rim
    Returns dictionaries with ``name``, ``quantity``, ``of``, ``at`` (point, centre or per component and step the extreme's place),
    ``values`` (component → list per step) and, in place of numbers that would not be true, ``why``
    """
    copies, nodal, found = Copies.of(scene), read.nodal, []
    for probe in (probe for probe in scene.probes if not isinstance(probe, Line)):
        if isinstance(probe, Point):
            names, values = read(probe)
            found.append(_told(probe, "point", probe.quantity, names, values[:, 0], at=probe.at))
        elif probe.quantity in FORCES:
            found.append(_forces(probe, nodal.fields, copies, parts, rims.get(probe.name, 0.0)))
        else:
            found.append(_over_surface(probe, scene, nodal))
    return found


def read_paths(scene: Scene, read: Reader) -> list[dict[str, object]]:
    """Per path of the scene ``name``, ``of``, ``distance`` (n,) from its first end, ``at`` (n, 3), and ``values``: component → (T, n), nan
    outside the body and where stresses are not to be believed."""
    return [{"name": probe.name, "of": probe.quantity, "distance": probe.distance, "at": probe.at,
             "values": {name: values[:, :, k] for k, name in enumerate(names)}}
            for probe in scene.probes if isinstance(probe, Line) for names, values in [read(probe)]]


def write_paths(folder: ResultsFolder, found: Sequence[Mapping[str, object]]) -> Path:
    """Writes paths.csv; what a path does not tell is empty."""
    rows = []
    for path in found:
        columns = [path["values"].get(name) for name in ALONG[6:]]
        for step in range(len(next(iter(path["values"].values())))):
            for k, (distance, at) in enumerate(zip(path["distance"].tolist(), path["at"].tolist())):
                numbers = [np.nan if column is None else float(column[step, k]) for column in columns]
                rows.append([path["name"], step + 1, repr(distance), *map(repr, at), *("" if x != x else repr(x) for x in numbers)])
    return folder.write_table(PATHS, [ALONG, *rows])


def _told(probe: Point | Section | Surface, quantity: str, of: str, names: Sequence[str], values: np.ndarray, **more: object) -> dict:
    """``values`` (T, components)."""
    known = bool(np.isfinite(values).all())
    told = {"name": probe.name, "quantity": quantity, "of": of, **more,
            "values": {name: column if known else None for name, column in zip(names, values.T.tolist())}}
    return told if known else told | {"why": FOREIGN}


def at_points(quantity: str, cells: np.ndarray, weights: np.ndarray, nodal: Nodal) -> tuple[Sequence[str], np.ndarray]:
    """Names of the components of displacement or stress, and (T, n, components) their values at points of tets.

    cells : (n,) int; weights : (n, 4) barycentric coordinates there
    """
    fields = nodal.fields
    if quantity == "stress":
        at = nodal.corner[cells]
        sigma = [np.einsum("na,nai->ni", weights, nodal.stress(step)[at]) for step in range(fields.steps)]
        return STRESS, components_of_stress(np.array(sigma))
    shape = np.array([tet_functions(w, fields.cells.shape[1]) for w in weights]).reshape(-1, fields.cells.shape[1])
    return DISPLACEMENT, components_of_displacement(np.einsum("na,tnai->tni", shape, fields.displacement[:, fields.cells[cells]]))


def _forces(probe: Section | Surface, fields: Fields, copies: Copies, parts: Sequence[np.ndarray],
            beside: np.ndarray | float) -> dict[str, object]:
    """Across a section, or through faces; beside : (T, 6) what is not theirs."""
    section = isinstance(probe, Section)
    names = (*RESULTANT, "normal", "shear") if section else RESULTANT
    values = np.full((fields.steps, len(names)), np.nan)
    if fields.believed is None or fields.believed[np.concatenate(cells_of(probe, copies))].all():
        values[:, : 7 if section else 6] = flux(probe, copies).of(parts) - beside
    if section:
        values[:, 7] = np.linalg.norm(values[:, :3] - values[:, 6:7] * probe.normal, axis=1)
    return _told(probe, probe.quantity, "force", names, values, at=probe.about)


def _over_surface(probe: Surface, scene: Scene, nodal: Nodal) -> dict[str, object]:
    """Mean or extreme. Means of stress are those of fields linear on each facet; of displacement, those of the element."""
    fields = nodal.fields
    stress = probe.of == "stress"
    triangles = probe.triangles[:, :3] if stress else probe.triangles
    local = (scene.mesh.cells[probe.cells][:, None, :] == triangles[:, :, None]).argmax(axis=2)
    at = (nodal.corner if stress else fields.cells)[probe.cells[:, None], local]
    names, components = (STRESS, components_of_stress) if stress else (DISPLACEMENT, components_of_displacement)
    area = np.linalg.norm(probe.area, axis=1)
    points = scene.mesh.nodes[triangles.reshape(-1)]
    rows, places = [], []
    for step in range(fields.steps):
        values = (nodal.stress(step) if stress else fields.displacement[step])[at]
        if probe.quantity == "mean":
            mean = np.einsum("k,a,kai->i", area, TRIANGLE_SHARES[triangles.shape[1]], values) / area.sum()
            rows.append(components(mean))
            continue
        each = components(values).reshape(len(points), -1)
        if not np.isfinite(each).all():
            rows.append(np.full(len(names), np.nan))
            continue
        place = (each.argmax if probe.quantity == "max" else each.argmin)(axis=0)
        rows.append(each[place, np.arange(len(names))])
        places.append(points[place])
    where = area @ scene.mesh.nodes[probe.triangles[:, :3]].mean(axis=1) / area.sum()
    if len(places) == fields.steps:
        where = {name: column for name, column in zip(names, np.array(places).swapaxes(0, 1).tolist())}
    return _told(probe, probe.quantity, probe.of, names, np.array(rows), at=where)
