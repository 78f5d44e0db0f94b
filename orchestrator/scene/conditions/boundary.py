"""Boundary conditions: every entry resolved to faces, and what they prescribe on the nodes of each body.

A condition belongs to the body whose face it is on. Copies of a node that perfect interfaces join move as one, so that
what is prescribed on one of them is so on all; where an interface opens, the neighbour's copy stays free.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.conditions.affine import KINDS, field_of, normal_of
from orchestrator.scene.conditions.frames import Cylindrical
from orchestrator.scene.conditions.selection import TOLERANCE, select
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry, Interface
from orchestrator.scene.partition.numbering import SplitNumbering

# Two entries agree when their values differ by rounding only.
SAME = 1e-12


def resolve_boundary(mesh: Mesh, faces: Faces, entries: list[Any], vectors: list[list[list[float | None]]],
                     factors: list[list[float]], problems: Problems) -> list[BoundaryEntry]:
    """Finds the faces of each entry of ``boundary:``.

    Parameters
    ----------
    vectors : per entry (steps, 3) values, None for free components; pressures in column 0; None for fields
    factors : per entry (steps,) what multiplies it
    """
    resolved = []
    for i, (entry, rows) in enumerate(zip(entries, vectors)):
        kind = next(k for k in KINDS if getattr(entry, k, None) is not None)
        chosen = select(mesh, faces, entry.on, ("boundary", i, "on"), problems)
        if mesh.foreign and len(chosen):  # what holds and loads them they bring along
            foreign = mesh.is_foreign(faces.owner[chosen])
            if foreign.all():
                name = mesh.volumes[mesh.volume[faces.owner[chosen[0]]]]
                problems.add(("boundary", i, "on"), f"faces of {name!r}, whose mesh is not this program's", "faces of parts with a mesh",
                             "put supports and loads in the part's own files")
            chosen = chosen[~foreign]
        if kind not in ("displacement", "motion", "symmetry") or entry.stands:
            inside = chosen[faces.neighbour[chosen] >= 0]
            if len(inside):
                where = format_point(mesh.nodes[faces.triangles[inside[0]]].mean(axis=0))
                problems.add(("boundary", i, "on"), f"{len(inside)} of {len(chosen)} faces lie inside the mesh, the "
                             f"first at {where}: a {kind} there has no side to act on", "faces of the outer boundary",
                             "select outer faces; for forces inside the body use loads:")
        triangles, cells = faces.triangles[chosen], np.c_[faces.owner[chosen], faces.neighbour[chosen]]
        if entry.stands:
            resolved.append(BoundaryEntry(i, "displacement", triangles, cells, np.unique(triangles), np.zeros(3, dtype=bool),
                                          np.zeros((len(factors[i]), 3))))
            continue
        frame = Cylindrical.of(entry.frame)
        if frame is not None and any(x for row in rows for x in row[:2]):  # what is zero is so in any direction
            frame.check(mesh.nodes, triangles, ("boundary", i, "frame"), problems)
        if kind == "symmetry":
            axis = normal_of(mesh.nodes, triangles)
            if axis is None:
                problems.add(("boundary", i, "on"), "a plane of symmetry that is curved, or across no axis",
                             "faces on a plane across x, y or z", "turn the model so that the plane is across an axis (parts "
                             "have move: {rotate: …}), or select the plane's faces alone")
            resolved.append(BoundaryEntry(i, "displacement", triangles, cells, np.unique(triangles), np.arange(3) == axis,
                                          np.zeros((len(factors[i]), 3))))
            continue
        if rows is None:
            acts, values, slope, about = field_of(entry, factors[i], mesh.nodes, triangles)
            resolved.append(BoundaryEntry(i, acts, triangles, cells, np.unique(triangles),
                                          np.full(3, acts == "displacement"), values, slope, about))
            continue
        given = np.array([[value is not None for value in row] for row in rows])
        if (given != given[0]).any():
            problems.add(("boundary", i, kind), "components that are free at some load steps only",
                         "the same components prescribed at every load step", "replace null by numbers, or numbers by null")
        values = np.array([[0.0 if value is None else value for value in row] for row in rows], dtype=float)
        resolved.append(BoundaryEntry(i, kind, triangles, cells, np.unique(triangles),
                                      given.all(axis=0) & (kind == "displacement"), values, frame=frame))
    return resolved


def moving_as_one(numbering: SplitNumbering, interfaces: list[Interface]) -> np.ndarray:
    """(N,) int, label of each split node: equal where perfect interfaces make nodes one.

    Parameters
    ----------
    interfaces : all there are, with their laws
    """
    perfect = [i for i in interfaces if i.law.perfect and i.matching]
    pairs = [[numbering.offsets[e] + own for e, own in zip(i.subdomains, i.nodes)] for i in perfect]
    one, two = (np.concatenate([np.empty(0, int), *side]) for side in (zip(*pairs) if pairs else ((), ())))
    if not all(i.law.perfect for i in interfaces):
        return components(one, two, len(numbering.nodes))[1]
    # nothing opens: copies of a node are one, and nodes that are numbered separately only where they are paired
    one, two = numbering.nodes[one], numbering.nodes[two]
    apart = one != two
    if not apart.any():
        return numbering.nodes
    return components(one[apart], two[apart], numbering.total)[1][numbering.nodes]


def prescribe(mesh: Mesh, boundary: list[BoundaryEntry], cell_subdomain: np.ndarray, numbering: SplitNumbering,
              label: np.ndarray, steps: int, problems: Problems) -> tuple[np.ndarray, np.ndarray]:
    """What displacement entries prescribe on split nodes; a later entry that agrees repeats an earlier one.

    Parameters
    ----------
    cell_subdomain : (m,) int
    label : (N,) int, of ``moving_as_one``

    Returns
    -------
    held_by : (N, 3) int, the last entry that prescribes each component, −1 for none
    prescribed : (steps, N, 3) float, zero where nothing is
    """
    count = int(label.max()) + 1
    setter = np.full((count, 3), -1)
    values = np.zeros((steps, count, 3))
    slack = TOLERANCE * np.array([reach(entry, mesh) for entry in boundary]).reshape(len(boundary), steps)
    for number, entry in enumerate(boundary):
        if not entry.fixed.any():
            continue
        at = _labels(entry, cell_subdomain, numbering, label)
        varies = None
        if entry.varies:  # copies of a node that are one are at one place, but for rounding
            first = np.zeros(count, dtype=int)
            first[label] = np.arange(len(label))
            points = mesh.nodes[numbering.nodes[first[at]]]
            varies = np.einsum("tij,nj->tni", entry.slope, points - entry.about) if entry.frame is None else \
                entry.frame.turned(entry.values, points) - entry.values[:, None]
        for c in np.flatnonzero(entry.fixed):
            earlier = setter[at, c]
            there = values[:, at, c]
            wanted = entry.values[:, c, None]
            if varies is not None:
                wanted = wanted + varies[:, :, c]
            differs = np.abs(there - wanted) > SAME * np.maximum(np.abs(there), np.abs(wanted)) + slack[number][:, None] + slack[earlier].T
            clash = (earlier >= 0) & differs.any(axis=0)
            if clash.any():
                first = int(np.flatnonzero(clash)[0])
                step = int(np.flatnonzero(differs[:, first])[0])
                node = numbering.nodes[np.flatnonzero(label == at[first])[0]]
                problems.add(("boundary", entry.index, "displacement"),
                             f"boundary[{earlier[first]}] and boundary[{entry.index}] contradict each other on "
                             f"{clash.sum()} nodes, the first at {format_point(mesh.nodes[node])}: u{'xyz'[c]} = "
                             f"{there[step, first]:g} and {np.broadcast_to(wanted, there.shape)[step, first]:g} at load "
                             f"step {step + 1}",
                             "one value per node and component",
                             f"put null for u{'xyz'[c]} in one of the two, or select faces that do not meet")
            values[:, at, c] = wanted
            setter[at, c] = entry.index
    return setter[label], values[:, label]


def reach(entry: BoundaryEntry, mesh: Mesh) -> np.ndarray:
    """(steps,) how much what an entry prescribes changes over the mesh: coordinates are rounded, so that it is so at every node."""
    if entry.frame is not None:
        return np.abs(entry.values).max(axis=1)
    if entry.slope is None:
        return np.zeros(len(entry.values))
    return np.linalg.norm(entry.slope, axis=(1, 2)) * float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))


def _labels(entry: BoundaryEntry, cell_subdomain: np.ndarray, numbering: SplitNumbering,
            label: np.ndarray) -> np.ndarray:
    """Labels, ascending, of the split nodes on an entry's faces: of the bodies that they belong to."""
    found = []
    for cells in entry.cells.T:
        there = cells >= 0
        found.append(numbering.find(cell_subdomain[cells[there], None], entry.triangles[there]).ravel())
    return np.unique(label[np.concatenate(found)])


def on_mesh(numbering: SplitNumbering, held_by: np.ndarray, prescribed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``fixed`` (n, 3) and ``prescribed`` (steps, n, 3) on the nodes of the mesh."""
    fixed = np.zeros((numbering.total, 3), dtype=bool)
    values = np.zeros((len(prescribed), numbering.total, 3))
    for c in range(3):
        own = np.flatnonzero(held_by[:, c] >= 0)
        fixed[numbering.nodes[own], c] = True
        values[:, numbering.nodes[own], c] = prescribed[:, own, c]
    return fixed, values
