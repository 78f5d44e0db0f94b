"""Values that were asked for, at every load step: at points, over surfaces and across sections;
along lines, of which paths.csv has a line
for each point and load step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from orchestrator.method.delivery.flux import FORCES
from orchestrator.results.extremes import (
    components_of_displacement, components_of_stress, DISPLACEMENT, Nodal, RESULTANT, STRESS)
from orchestrator.results.folder import ResultsFolder
from orchestrator.scene.conditions.probes import ProbeLine, ProbePoint, ProbeSection, ProbeSurface
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions

NAME, PATHS = "probes.csv", "paths.csv"
# columns of the latter
ALONG = ("path", "load_step", "distance", "x", "y", "z", *DISPLACEMENT, *STRESS)
FOREIGN = "the matter there is its code's own: what it is stressed by is not known here"


def along(probe: ProbePoint | ProbeLine, nodal: Nodal) -> tuple[Sequence[str], np.ndarray]:
    """Return names of the components of displacement or stress, and (T, n, components) their
    values, nan outside the body.
    """
    cells, weights = (probe.cells,
                      probe.weights) if isinstance(probe,
                                                   ProbeLine) else (
                                                       np.array([probe.cell]), probe.weights[None])
    own = cells >= 0
    names, found = at_points(probe.quantity, cells[own], weights[own], nodal)
    values = np.full((len(found), len(cells), len(names)), np.nan)
    values[:, own] = found
    return names, values


def over(probe: ProbeSurface, nodal: Nodal) -> tuple[Sequence[str], np.ndarray, np.ndarray | None]:
    """Return names of the components, (T, components) the mean of each, or its extreme, and (T,
    components, 3) where extremes are.

    Means of stress are those of fields linear on each facet; of displacement, those of the element.
    """
    fields, stress = nodal.fields, probe.of == "stress"
    corners = probe.corners[:, :3] if stress else probe.corners
    names, components = (STRESS,
                         components_of_stress) if stress else (
                             DISPLACEMENT, components_of_displacement)
    at = (nodal.corner if stress else fields.cells)[probe.cells[:, None], corners]
    each = np.stack([(nodal.stress(step) if stress else fields.displacement[step])[at]
                     for step in range(fields.steps)])
    if probe.quantity == "mean":
        share = np.linalg.norm(probe.area, axis=1) / probe.total
        return names, components(np.einsum("k,a,tkai->ti", share, TRIANGLE_SHARES[corners.shape[1]],
                                           each)), None
    each = components(each.reshape(len(each), at.size, each.shape[-1]))
    each[~np.isfinite(each).all(axis=(1, 2))] = np.nan
    # which find what is no number first
    place = (each.argmax if probe.quantity == "max" else each.argmin)(axis=1)
    points = fields.nodes[fields.cells[probe.cells[:, None], corners].ravel()]
    return names, np.take_along_axis(each, place[:, None], 1)[:, 0], points[place]


def read_probes(probes: Sequence[ProbePoint | ProbeLine | ProbeSection | ProbeSurface],
                nodal: Nodal, carried: Mapping[str, np.ndarray]) -> list[dict[str, object]]:
    """Per probe its name, what it tells, and per component the values of all load steps; of lines
    nothing.

    carried : name of a probe of forces → (T, c) what these are
    Returns dictionaries with ``name``, ``quantity``, ``of``, ``at`` (point, centre or per component
    and step the extreme's place), ``values`` (component → list per step) and, in place of numbers
    that would not be true, ``why``
    """
    return [_at_point(probe, nodal) if isinstance(probe, ProbePoint)
            else _forces(probe, carried[probe.name]) if probe.quantity in FORCES
            else _over_surface(probe, nodal) for probe in probes
            if not isinstance(probe, ProbeLine)]


def read_paths(probes: Sequence[object], nodal: Nodal) -> list[dict[str, object]]:
    """Per path among probes ``name``, ``of``, ``distance`` (n,) from its first end, ``at`` (n, 3),
    and ``values``: component → (T, n), nan
    outside the body and where stresses are not to be believed."""
    return [{"name": probe.name, "of": probe.quantity, "distance": probe.distance, "at": probe.at,
             "values": {name: values[:, :, k] for k, name in enumerate(names)}}
            for probe in probes if isinstance(probe, ProbeLine)
            for names, values in [along(probe, nodal)]]


def write_paths(folder: ResultsFolder, found: Sequence[Mapping[str, object]]) -> Path:
    """Writes paths.csv; what a path does not tell is empty."""
    rows = []
    for path in found:
        columns = [path["values"].get(name) for name in ALONG[6:]]
        for step in range(len(next(iter(path["values"].values())))):
            for k, (distance, at) in enumerate(zip(path["distance"].tolist(), path["at"].tolist())):
                numbers = [np.nan if column is None else float(column[step, k])
                           for column in columns]
                rows.append([path["name"], step + 1, repr(distance), *map(repr, at),
                             *("" if x != x else repr(x) for x in numbers)])
    return folder.write_table(PATHS, [ALONG, *rows])


def _told(probe: ProbePoint | ProbeSection | ProbeSurface, quantity: str, of: str,
          names: Sequence[str], values: np.ndarray, **more: object) -> dict:
    """``values`` (T, components)."""
    known = bool(np.isfinite(values).all())
    told = {"name": probe.name, "quantity": quantity, "of": of, **more,
            "values": {name: column if known else None
                       for name, column in zip(names, values.T.tolist())}}
    return told if known else told | {"why": FOREIGN}


def at_points(quantity: str, cells: np.ndarray, weights: np.ndarray,
              nodal: Nodal) -> tuple[Sequence[str], np.ndarray]:
    """Names of the components of displacement or stress, and (T, n, components) their values at
    points of tets.

    cells : (n,) int; weights : (n, 4) barycentric coordinates there
    """
    fields = nodal.fields
    if quantity == "stress":
        at = nodal.corner[cells]
        sigma = [np.einsum("na,nai->ni", weights, nodal.stress(step)[at])
                 for step in range(fields.steps)]
        return STRESS, components_of_stress(np.array(sigma))
    shape = np.array([tet_functions(w, fields.cells.shape[1]) for w in weights]).reshape(
        -1, fields.cells.shape[1])
    return DISPLACEMENT, components_of_displacement(
        np.einsum("na,tnai->tni", shape, fields.displacement[:, fields.cells[cells]]))


def _at_point(probe: ProbePoint, nodal: Nodal) -> dict[str, object]:
    names, values = along(probe, nodal)
    return _told(probe, "point", probe.quantity, names, values[:, 0], at=probe.at)


def _forces(probe: ProbeSection | ProbeSurface, carried: np.ndarray) -> dict[str, object]:
    """Across a section, or through faces."""
    if not isinstance(probe, ProbeSection):
        return _told(probe, probe.quantity, "force", RESULTANT, carried, at=probe.about)
    shear = np.linalg.norm(carried[:, :3] - carried[:, 6:7] * probe.normal, axis=1)
    return _told(probe, probe.quantity, "force", (*RESULTANT, "normal", "shear"),
                 np.column_stack([carried, shear]), at=probe.about)


def _over_surface(probe: ProbeSurface, nodal: Nodal) -> dict[str, object]:
    """Mean or extreme."""
    names, values, places = over(probe, nodal)
    known = places is not None and np.isfinite(values).all()
    where = {name: column
             for name, column in zip(names,
                                     places.swapaxes(0, 1).tolist())} if known else probe.centre
    return _told(probe, probe.quantity, probe.of, names, values, at=where)
