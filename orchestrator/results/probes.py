"""Values that were asked for, at every load step: at points, over surfaces and across sections;
along lines, of which paths.csv has a line for each point and load step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orchestrator.method.delivery.flux import FORCES
from orchestrator.results.extremes import (
    components_of_displacement, components_of_stress, DISPLACEMENT, Nodal, RESULTANT, STRESS)
from orchestrator.scene.conditions.probes import ProbeLine, ProbePoint, ProbeSection, ProbeSurface
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions

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


def over(probe: ProbeSurface, nodal: Nodal) -> tuple[np.ndarray, np.ndarray | None]:
    """Return (T, components) the mean of each component, or its extreme, and (T, components, 3)
    where extremes are.

    Means of stress are those of fields linear on each facet; of displacement, those of the element.
    """
    fields, stress = nodal.fields, probe.of == "stress"
    corners, components = probe.corners[:, :3] if stress else probe.corners, COMPONENTS[probe.of][1]
    at = (nodal.corner if stress else fields.cells)[probe.cells[:, None], corners]
    each = np.stack([(nodal.stress(step) if stress else fields.displacement[step])[at]
                     for step in range(fields.steps)])
    if probe.quantity == "mean":
        share = np.linalg.norm(probe.area, axis=1) / probe.total
        return components(np.einsum("k,a,tkai->ti", share, TRIANGLE_SHARES[corners.shape[1]],
                                    each)), None
    each = components(each.reshape(len(each), at.size, each.shape[-1]))
    each[~np.isfinite(each).all(axis=(1, 2))] = np.nan
    # which find what is no number first
    place = (each.argmax if probe.quantity == "max" else each.argmin)(axis=1)
    points = fields.nodes[fields.cells[probe.cells[:, None], corners].ravel()]
    return np.take_along_axis(each, place[:, None], 1)[:, 0], points[place]


def read_probes(probes: Sequence[object], nodal: Nodal,
                carried: Mapping[str, np.ndarray]) -> list[dict[str, object]]:
    """Per probe its name, what it tells, and per component the values of all load steps; of lines
    nothing.

    carried : name of a probe of forces → (T, c) what these are
    Returns dictionaries with ``name``, ``quantity``, ``of``, ``at`` (point, centre or per component
    and step the extreme's place), ``values`` (component → list per step) and, in place of numbers
    that would not be true, ``why``
    """
    return [_told(probe, nodal, carried) for probe in probes if not isinstance(probe, ProbeLine)]


def _told(probe: ProbePoint | ProbeSection | ProbeSurface, nodal: Nodal,
          carried: Mapping[str, np.ndarray]) -> dict[str, object]:
    places = None
    if isinstance(probe, ProbePoint):
        quantity, of, at = "point", probe.quantity, probe.at
        names, components = COMPONENTS[of]
        values = components(at_points(of, np.array([probe.cell]), probe.weights[None], nodal)[:, 0])
    elif probe.quantity in FORCES:  # across a section, or through faces
        quantity, of, names, at = probe.quantity, "force", RESULTANT, probe.about
        values = carried[probe.name]
        if isinstance(probe, ProbeSection):
            shear = np.linalg.norm(values[:, :3] - values[:, 6:7] * probe.normal, axis=1)
            names, values = (*names, "normal", "shear"), np.column_stack([values, shear])
    else:
        quantity, of, names, at = probe.quantity, probe.of, COMPONENTS[probe.of][0], probe.centre
        values, places = over(probe, nodal)
    known = bool(np.isfinite(values).all())
    if known and places is not None:
        at = dict(zip(names, places.swapaxes(0, 1).tolist()))
    told = {name: column if known else None for name, column in zip(names, values.T.tolist())}
    return {"name": probe.name, "quantity": quantity, "of": of, "at": at, "values": told} | (
        {} if known else {"why": FOREIGN})


def read_paths(probes: Sequence[object], nodal: Nodal) -> list[dict[str, object]]:
    """Per path among probes ``name``, ``of``, ``distance`` (n,) from its first end, ``at`` (n, 3),
    and ``values``: component → (T, n), nan outside the body and where stresses are not to be
    believed.
    """
    return [{"name": probe.name, "of": probe.quantity, "distance": probe.distance, "at": probe.at,
             "values": dict(zip(names, np.moveaxis(components(at_points(
                 probe.quantity, probe.cells, probe.weights, nodal)), 2, 0)))}
            for probe in probes if isinstance(probe, ProbeLine)
            for names, components in [COMPONENTS[probe.quantity]]]


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
