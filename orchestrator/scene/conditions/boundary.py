"""Boundary conditions: every entry resolved to faces, and what they prescribe on the nodes of each
body.

A condition belongs to the body whose face it is on. Copies of a node that perfect interfaces join
move as one, so that what is prescribed on one of them is so on all; where an interface opens, the
neighbour's copy stays free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.errors import KeyPath, Problems, some
from orchestrator.linalg import SAME
from orchestrator.scene.loads.base import Cylindrical, FacePlace, Prescribed
from orchestrator.scene.conditions.selection import TOLERANCE, select
from orchestrator.scene.interfaces.parts import bonded
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh, SplitNumbering
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import BoundaryEntry
from orchestrator.scene.names import matching, suggestion


def resolve_boundary(mesh: Mesh, faces: Faces, entries: Sequence[Any],
                     factors: Sequence[Sequence[float]],
                     problems: Problems) -> list[BoundaryEntry]:
    """Effect of each entry of ``boundary:``, with its faces.

    factors : per entry (steps,) what multiplies it
    """
    resolved = []
    for i, (entry, times) in enumerate(zip(entries, factors)):
        path = ("boundary", i)
        meant = select(mesh, faces, entry.on, (*path, "on"), problems)
        chosen = _with_meshes(mesh, faces, _of_part(mesh, faces, meant, entry.part, path, problems),
                              path, problems)
        triangles = faces.triangles[chosen]
        does = acting(mesh, triangles, entry, times, path, problems)
        inside = chosen[faces.neighbour[chosen] >= 0]
        if len(inside) and not isinstance(does, Prescribed):
            where = format_point(mesh.nodes[faces.triangles[inside[0]]].mean(axis=0))
            problems.add((*path, "on"),
                         f"{len(inside)} of {len(chosen)} faces lie inside the mesh, the first at "
                         f"{where}: a {entry.acts} there has no side to act "
                         "on", "faces of the outer boundary",
                         "select outer faces; for forces inside the body use loads:")
        cells = np.c_[faces.owner[chosen], faces.neighbour[chosen]]
        resolved.append(BoundaryEntry(i, entry.acts, triangles, cells, np.unique(triangles), does))
    return resolved


def acting(mesh: Mesh, triangles: np.ndarray, entry: Any, factors: Sequence[float], path: KeyPath,
           problems: Problems) -> Any:
    """Effect of an entry of ``boundary:`` on faces (k, 3 or 6)."""
    where = FacePlace((*path, entry.acts), mesh.nodes, triangles, np.array(factors, dtype=float),
                    Cylindrical.of(entry.frame), problems)
    return entry.kind.made(entry.given, where)


def _of_part(mesh: Mesh, faces: Faces, chosen: np.ndarray, part: str | None, path: KeyPath,
             problems: Problems) -> np.ndarray:
    """Faces that are a part's; all where none is named."""
    if part is None or not len(chosen):
        return chosen
    meant = matching(part, mesh.volumes)
    if not meant:
        problems.add((*path, "part"), f"no volume is called {part!r}",
                     "a name of one, shell wildcards allowed",
                     suggestion(part, mesh.volumes, "volume"))
        return chosen[:0]
    own = np.isin(mesh.volumes, meant)
    kept = own[mesh.volume[faces.owner[chosen]]] | ((faces.neighbour[chosen] >= 0)
                                                    & own[mesh.volume[faces.neighbour[chosen]]])
    if not kept.any():
        whose = some(
            list(dict.fromkeys(mesh.volumes[v] for v in mesh.volume[faces.owner[chosen]].tolist())),
            4)
        problems.add((*path, "part"), f"{part!r} has none of these faces, which are of {whose}",
                     "a part that has",
                     "name another part, or leave it out")
    return chosen[kept]


def _with_meshes(mesh: Mesh, faces: Faces, chosen: np.ndarray, path: KeyPath,
                 problems: Problems) -> np.ndarray:
    """Faces that are not of parts whose mesh is not ours: what holds and loads these they bring
    along.
    """
    if not mesh.foreign or not len(chosen):
        return chosen
    foreign = mesh.is_foreign(faces.owner[chosen])
    if foreign.all():
        name = mesh.volumes[mesh.volume[faces.owner[chosen[0]]]]
        problems.add((*path, "on"), f"faces of {name!r}, whose mesh is not this program's",
                     "faces of parts with a mesh",
                     "put supports and loads in the part's own files")
    return chosen[~foreign]


def moving_as_one(numbering: SplitNumbering, interfaces: list[Interface]) -> np.ndarray:
    """(N,) int, label of each split node: equal where perfect interfaces make nodes one.

    interfaces : all there are, with their laws
    """
    label = bonded(numbering, interfaces)
    if not all(i.law.perfect for i in interfaces):
        return label
    # nothing opens: copies of a node are one, and nodes that are numbered separately only where
    # they are paired
    return components(numbering.nodes, numbering.total + label,
                      numbering.total + len(label))[1][numbering.nodes]


@dataclass
class Held:
    """Displacements prescribed on split nodes.

    label : (N,) int, of ``moving_as_one``
    by : (N, 3) int, the last entry that prescribes each component, −1 for none
    values : (steps, N, 3) float, zero where nothing is
    """

    mesh: Mesh
    boundary: list[BoundaryEntry]
    numbering: SplitNumbering
    label: np.ndarray
    by: np.ndarray
    values: np.ndarray

    @property
    def fixed(self) -> np.ndarray:
        """(N, 3) bool, with what parts of other programs hold themselves: no other body has their
        nodes.
        """
        fixed, nodes = self.by >= 0, self.numbering.nodes
        for stand in self.mesh.foreign:
            fixed[(nodes >= stand.nodes.start) & (nodes < stand.nodes.stop)] |= stand.held
        return fixed

    def changes(self) -> np.ndarray:
        """(entries, steps) how much what each entry prescribes changes over the mesh, at most."""
        return np.array([entry.prescribed.field.change(entry.prescribed.amounts, self.mesh.diagonal)
                         if entry.prescribed
                         else np.zeros(len(self.values)) for entry in self.boundary]).reshape(
                             len(self.boundary), len(self.values))

    def on_mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """``fixed`` (n, 3) and ``prescribed`` (steps, n, 3) on the nodes of the mesh."""
        fixed = np.zeros((self.numbering.total, 3), dtype=bool)
        values = np.zeros((len(self.values), self.numbering.total, 3))
        own, c = np.nonzero(self.by >= 0)
        fixed[self.numbering.nodes[own], c] = True
        values[:, self.numbering.nodes[own], c] = self.values[:, own, c]
        for stand in self.mesh.foreign:
            fixed[stand.nodes] |= stand.held
        return fixed, values


def prescribe(mesh: Mesh, boundary: list[BoundaryEntry], cell_subdomain: np.ndarray,
              numbering: SplitNumbering,
              label: np.ndarray, steps: int, problems: Problems) -> Held:
    """Displacements that entries prescribe on split nodes; a later entry that agrees repeats an
    earlier one.

    cell_subdomain : (m,) int
    label : (N,) int, of ``moving_as_one``
    """
    count = int(label.max()) + 1
    setter = np.full((count, 3), -1)
    values = np.zeros((steps, count, 3))
    held = Held(mesh, boundary, numbering, label, np.full((len(label), 3), -1),
                np.zeros((steps, len(label), 3)))
    slack = TOLERANCE * held.changes()
    first = np.zeros(count, dtype=int)
    first[label] = np.arange(len(label))
    for number, entry in enumerate(boundary):
        if entry.prescribed is None:
            continue
        at = _labels(entry, cell_subdomain, numbering, label)
        # copies that are one are at one place, but for rounding
        given = entry.prescribed.at(mesh.nodes[numbering.nodes[first[at]]])
        for c in np.flatnonzero(entry.prescribed.fixed):
            earlier, there, wanted = setter[at, c], values[:, at, c], given[:, :, c]
            differs = np.abs(there - wanted) > SAME * np.maximum(
                np.abs(there), np.abs(wanted)) + slack[number][:, None] + slack[earlier].T
            clash = (earlier >= 0) & differs.any(axis=0)
            if clash.any():
                one = int(np.flatnonzero(clash)[0])
                step = int(np.flatnonzero(differs[:, one])[0])
                problems.add(("boundary", entry.index, "displacement"),
                             f"boundary[{earlier[one]}] and boundary[{entry.index}] contradict "
                             f"each other on {clash.sum()} nodes, the first at "
                             f"{format_point(mesh.nodes[numbering.nodes[first[at[one]]]])}: "
                             f"u{'xyz'[c]} = {there[step, one]:g} and {wanted[step, one]:g} at "
                             f"load step {step + 1}",
                             "one value per node and component",
                             f"put null for u{'xyz'[c]} in one of the two, or select faces that "
                             "do not meet")
            values[:, at, c] = wanted
            setter[at, c] = entry.index
    held.by, held.values = setter[label], values[:, label]
    return held


def _labels(entry: BoundaryEntry, cell_subdomain: np.ndarray, numbering: SplitNumbering,
            label: np.ndarray) -> np.ndarray:
    """Labels, ascending, of the split nodes on an entry's faces: of the bodies that they belong
    to.
    """
    found = []
    for cells in entry.cells.T:
        there = cells >= 0
        found.append(numbering.find(cell_subdomain[cells[there], None],
                                    entry.triangles[there]).ravel())
    return np.unique(label[np.concatenate(found)])
