"""Boundary conditions: every entry resolved to faces, and what they prescribe on the nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.conditions.selection import select
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.quality import format_point
from orchestrator.scene.model import BoundaryEntry, Mesh

KINDS = ("displacement", "traction", "pressure")
# Two entries agree when their values differ by rounding only.
SAME = 1e-12


def resolve_boundary(mesh: Mesh, faces: Faces, entries: list[Any], vectors: list[list[list[float | None]]],
                     problems: Problems) -> list[BoundaryEntry]:
    """Finds the faces of each entry of ``boundary:``.

    Parameters
    ----------
    vectors : per entry (steps, 3) values, None for free components; pressures in column 0
    """
    resolved = []
    for i, (entry, rows) in enumerate(zip(entries, vectors)):
        kind = next(k for k in KINDS if getattr(entry, k, None) is not None)
        chosen = select(mesh, faces, entry.on, ("boundary", i, "on"), problems)
        if kind != "displacement":
            inside = chosen[faces.neighbour[chosen] >= 0]
            if len(inside):
                where = format_point(mesh.nodes[faces.triangles[inside[0]]].mean(axis=0))
                problems.add(("boundary", i, "on"), f"{len(inside)} of {len(chosen)} faces lie inside the mesh, the "
                             f"first at {where}: a {kind} there has no side to act on", "faces of the outer boundary",
                             "select outer faces; for forces inside the body use loads:")
        given = np.array([[value is not None for value in row] for row in rows])
        if (given != given[0]).any():
            problems.add(("boundary", i, kind), "components that are free at some load steps only",
                         "the same components prescribed at every load step", "replace null by numbers, or numbers by null")
        values = np.array([[0.0 if value is None else value for value in row] for row in rows], dtype=float)
        triangles = faces.triangles[chosen]
        resolved.append(BoundaryEntry(i, kind, triangles, faces.owner[chosen], np.unique(triangles),
                                      given.all(axis=0) & (kind == "displacement"), values))
    return resolved


def prescribe(mesh: Mesh, boundary: list[BoundaryEntry], steps: int,
              problems: Problems) -> tuple[np.ndarray, np.ndarray]:
    """Prescribed components and their values on the nodes of the mesh.

    Entries may meet on a node as long as they do not contradict each other there.

    Returns
    -------
    fixed : (n, 3) bool
    prescribed : (steps, n, 3) float, zero where not fixed
    """
    count = len(mesh.nodes)
    setter = np.full((count, 3), -1)
    prescribed = np.zeros((steps, count, 3))
    for entry in boundary:
        for c in np.flatnonzero(entry.fixed):
            earlier = setter[entry.nodes, c]
            there = prescribed[:, entry.nodes, c]
            wanted = entry.values[:, c, None]
            differs = np.abs(there - wanted) > SAME * np.maximum(np.abs(there), np.abs(wanted))
            clash = (earlier >= 0) & differs.any(axis=0)
            if clash.any():
                at = int(np.flatnonzero(clash)[0])
                step = int(np.flatnonzero(differs[:, at])[0])
                problems.add(("boundary", entry.index, "displacement"),
                             f"boundary[{earlier[at]}] and boundary[{entry.index}] contradict each other on "
                             f"{clash.sum()} nodes, the first at {format_point(mesh.nodes[entry.nodes[at]])}: u{'xyz'[c]} = "
                             f"{there[step, at]:g} and {entry.values[step, c]:g} at load step {step + 1}",
                             "one value per node and component",
                             f"put null for u{'xyz'[c]} in one of the two, or select faces that do not meet")
            prescribed[:, entry.nodes, c] = wanted
            setter[entry.nodes, c] = entry.index
    return setter >= 0, prescribed
