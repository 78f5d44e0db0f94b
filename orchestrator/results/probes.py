"""Values that were asked for: at points, and over surfaces, at every load step.

A resultant is all that acts on the body through the nodes of a surface,

    R = Σ_n (K u − p)_n + Σ_faces ∫ t,      M = Σ (x − x₀) × …,

with K u of the tets around its nodes, p all their loads, t the tractions on the faces themselves: supports, loads and what
interfaces carry there. What holds a node of the rim, and what an interface carries there, counts where that entry of
``boundary``, or that interface, has faces of the surface too; where several such entries hold a node, for the last, as among
the reactions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.blackbox.models.matter import Matter
from orchestrator.results.extremes import (DISPLACEMENT, STRESS, components_of_displacement, components_of_stress)
from orchestrator.results.fields.fields import Fields
from orchestrator.results.fields.nodal import Nodal
from orchestrator.results.sections import copies, section_forces
from orchestrator.scene.conditions.probes import Line, Point, Section, Surface
from orchestrator.scene.mesh.faces import pack
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES, tet_functions
from orchestrator.scene.model import Scene

NAME = "probes.csv"
RESULTANT = ("fx", "fy", "fz", "mx", "my", "mz")
FOREIGN = "the matter there is its code's own: what it is stressed by is not known here"


def read_probes(scene: Scene, nodal: Nodal, parts: Sequence[np.ndarray]) -> list[dict[str, object]]:
    """Per probe of the scene its name, what it tells, and per component the values of all load steps.

    parts : per subdomain (T, n_E, 3), in equilibrium with its interface forces
    Returns dictionaries with ``name``, ``quantity``, ``of``, ``at`` (point, centre or per component and step the extreme's place),
    ``values`` (component → list per step) and, in place of numbers that would not be true, ``why``
    """
    return [_at_point(probe, nodal) if isinstance(probe, Point)
            else _across(probe, scene, nodal.fields, parts) if isinstance(probe, Section)
            else _resultant(probe, scene, nodal.fields, parts) if probe.quantity == "resultant"
            else _over_surface(probe, scene, nodal) for probe in scene.probes if not isinstance(probe, Line)]


def _told(probe: Point | Section | Surface, quantity: str, of: str, names: Sequence[str], values: np.ndarray, **more: object) -> dict:
    """``values`` (T, components)."""
    known = bool(np.isfinite(values).all())
    told = {"name": probe.name, "quantity": quantity, "of": of, **more,
            "values": {name: column if known else None for name, column in zip(names, values.T.tolist())}}
    return told if known else told | {"why": FOREIGN}


def _at_point(probe: Point, nodal: Nodal) -> dict[str, object]:
    fields, cell = nodal.fields, probe.cell
    if probe.quantity == "stress":
        sigma = np.array([probe.weights @ nodal.stress(step)[nodal.corner[cell]] for step in range(fields.steps)])
        return _told(probe, "point", "stress", STRESS, components_of_stress(sigma), at=probe.at)
    shape = tet_functions(probe.weights, fields.cells.shape[1])
    u = np.einsum("a,tai->ti", shape, fields.displacement[:, fields.cells[cell]])
    return _told(probe, "point", "displacement", DISPLACEMENT, components_of_displacement(u), at=probe.at)


def _across(probe: Section, scene: Scene, fields: Fields, parts: Sequence[np.ndarray]) -> dict[str, object]:
    total = section_forces(probe, scene, fields, parts)
    along = total[:, :3] @ probe.normal
    across = np.linalg.norm(total[:, :3] - along[:, None] * probe.normal, axis=1)
    return _told(probe, "section", "force", (*RESULTANT, "normal", "shear"), np.column_stack([total, along, across]), at=probe.about)


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


def _resultant(probe: Surface, scene: Scene, fields: Fields, parts: Sequence[np.ndarray]) -> dict[str, object]:
    ends, cells, node, label = copies(scene, fields)
    local = (scene.mesh.cells[probe.cells][:, None, :] == probe.triangles[:, :, None]).argmax(axis=2)
    chosen = np.isin(label, label[cells[probe.cells[:, None], local]])  # (N,) copies on the surface
    around = chosen[cells].any(axis=1) & (np.isin(scene.mesh.volume, probe.within) if len(probe.within) else True)
    around = np.flatnonzero(around)
    if fields.believed is not None and not fields.believed[around].all():
        return _told(probe, "resultant", "force", RESULTANT, np.full((scene.steps, 6), np.nan), at=probe.about)
    used, own = np.unique(cells[around], return_inverse=True)
    u = np.concatenate(parts, axis=1)[:, used]
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])[scene.cell_material[around]]
    points = scene.mesh.nodes[node[used]]
    held = Matter(points, own.reshape(len(around), -1), *moduli.T).forces(u.reshape(len(u), -1)).reshape(u.shape)
    loads = np.concatenate([s.loads for s in scene.subdomains], axis=1)[:, used]
    count = len(scene.mesh.nodes)
    mine = pack(probe.triangles[:, :3], count)
    on = [np.isin(pack(entry.triangles[:, :3], count), mine) for entry in scene.boundary]
    held_by = np.concatenate([s.held_by for s in scene.subdomains])[used]
    others = (held_by >= 0) & ~np.array([*(faces.any() for faces in on), False])[held_by]
    here, others = chosen[used], others | ((held_by < 0) & _elsewhere(probe, scene, mine, ends)[used][:, None])
    forces, arm = np.where(others, 0.0, held - loads)[:, here], points[here] - probe.about
    total = np.concatenate([forces.sum(axis=1), np.cross(arm, forces).sum(axis=1)], axis=1)
    for entry, faces in zip(scene.boundary, on):
        if entry.forces and faces.any():
            total += entry.forces.of(faces).resultant(scene.mesh.nodes[entry.triangles[faces]], probe.about)
    return _told(probe, "resultant", "force", RESULTANT, total, at=probe.about)


def _elsewhere(probe: Surface, scene: Scene, mine: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N,) bool, copies of nodes at which interfaces act that have no face on the surface: theirs are not its forces.

    mine : keys of the surface's faces; ends : where the subdomains' copies begin
    """
    on, beside = np.zeros((2, int(ends[-1])), dtype=bool)
    volumes = [scene.mesh.volume[s.cells[0]] for s in scene.subdomains]
    for i in scene.interfaces:
        within = not len(probe.within) or np.isin([volumes[e] for e in i.subdomains], probe.within).all()
        if i.law.perfect and i.mortar is None and within:
            continue  # both sides are counted
        for side, e in enumerate(i.subdomains):
            faces = scene.side_nodes(i, side)[i.triangles_on(side)[:, :3]]
            (on if np.isin(pack(faces, len(scene.mesh.nodes)), mine).any() else beside)[ends[e] + i.nodes[side]] = True
    return beside & ~on
