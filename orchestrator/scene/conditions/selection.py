"""Which faces an ``on`` of the YAML means: a named surface, a plane or a box."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import KeyPath, Problems
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion

# Planes and boxes are met within this share of the mesh's diagonal: digits of the YAML and of files. But not where that is
# more than a share of what the tet behind a face measures across: then the next face of a thin part is as near.
TOLERANCE, THICKNESS = 1e-6, 0.01
# Of the mesh's diagonal: faces nearer than that are met exactly.
EXACT = 1e-12


def select(mesh: Mesh, faces: Faces, on: Any, path: KeyPath, problems: Problems) -> np.ndarray:
    """Indices of the faces selected; empty, with a problem, when there are none.

    A plane or a box takes the faces of the outer boundary that have all three nodes in it, see ``Outside.met``. A named surface
    may also lie inside the mesh.
    """
    if isinstance(on, str):
        return _named(mesh, faces, on, path, problems)
    outside = Outside(mesh, faces, path, problems)
    return outside.on_plane(on) if getattr(on, "plane", None) is not None else outside.in_box(on)


def _named(mesh: Mesh, faces: Faces, on: str, path: KeyPath, problems: Problems) -> np.ndarray:
    names = matching(on, mesh.surfaces)
    if not names:
        volume = ", only a volume" if matching(on, mesh.volumes) else ""
        problems.add(path, f"no surface is called {on!r}{volume}", "the name of a surface of the mesh, shell wildcards "
                     "allowed, or {plane: x, at: 0}, or {box: [[0, 0, 0], [1, 1, 1]]}",
                     suggestion(on, mesh.surfaces, "surface; select a plane or a box instead")
                     if not mesh.surfaces else suggestion(on, mesh.surfaces, "surface"))
        return np.empty(0, dtype=int)
    triangles = np.concatenate([mesh.surfaces[name] for name in names])
    if not len(triangles):
        problems.add(path, f"{on!r} is a surface without triangles on the tets", "a surface that has some",
                     "put faces of the body in the group and save them with the mesh, or select a plane or a box")
    found = faces.find(triangles)
    if (found < 0).any():
        bad = triangles[np.flatnonzero(found < 0)[0]]
        problems.add(path, f"{np.sum(found < 0)} of {len(triangles)} triangles of {on!r} are no faces of tets, "
                     f"the first at {format_point(mesh.nodes[bad].mean(axis=0))}", "triangles that are faces of tets",
                     "mesh the surface and the volume together")
    return np.unique(found[found >= 0])


class Outside:
    """The outer boundary of a mesh, of which an ``on`` at a path of the YAML means some faces."""

    def __init__(self, mesh: Mesh, faces: Faces, path: KeyPath, problems: Problems):
        self.mesh, self.faces, self.path, self.problems = mesh, faces, path, problems
        self.outer = faces.outer
        self.corners = mesh.nodes[faces.triangles[self.outer]]

    def met(self, away: np.ndarray, axes: list[int], what: str) -> np.ndarray:
        """(k,) bool, the outer faces that a plane or a box takes: those that it meets but for digits.

        Faces of thin parts may be as near as that without being meant. Where some faces are met exactly, those are left out that
        are off by a share of what these are thick; where none is, and others are left out, nobody knows which are meant.

        away : (k, a) how far nodes of theirs are off, at most, along the ``axes``
        what : the plane or the box, for messages
        """
        mesh, size = self.mesh, self.mesh.diagonal
        near = np.flatnonzero((away <= TOLERANCE * size).all(axis=1))
        off, across = away[near].max(axis=1), np.ptp(mesh.nodes[mesh.cells[self.faces.owner[self.outer[near]], :4]], axis=1)[:, axes]
        taken = (away[near] <= np.maximum(THICKNESS * across, EXACT * size)).all(axis=1)
        exact = off <= EXACT * size
        if exact.any():
            taken &= exact | (off <= THICKNESS * np.median(across[exact].min(axis=1)))
        elif taken.any() and not taken.all():
            self.problems.add(self.path, f"{what} meets no face exactly; some are up to {off[taken].max():.3g} off, as are others of thin parts, by up "
                         f"to {off[~taken].max():.3g}", "the coordinates of the faces that are meant",
                         "write them with all their digits, or name a surface of the mesh")
        hit = np.zeros(len(self.outer), dtype=bool)
        hit[near[taken]] = True
        return hit

    def on_plane(self, on: Any) -> np.ndarray:
        """Indices of the faces that lie on a plane across an axis."""
        axis = "xyz".index(on.plane)
        along = self.corners[:, :, axis]
        distance = np.abs(along - on.at)
        hit = self.met(distance.max(axis=1)[:, None], [axis], f"the plane {on.plane} = {on.at:g}")
        if not hit.any():
            nearest = along.reshape(-1)[np.argmin(distance)]
            self.problems.add(self.path, f"no boundary face lies on the plane {on.plane} = {on.at:g}; the nearest boundary node is "
                         f"{distance.min():.6g} away, at {on.plane} = {nearest:.6g}",
                         f"a plane that holds faces of the boundary; the mesh spans {on.plane} from {along.min():.6g} "
                         f"to {along.max():.6g}",
                         f"set at: to the {on.plane} of a flat side of the mesh" + (
                             "; if the unit of length differs, set scale: under mesh:"
                             if not along.min() <= on.at <= along.max() else ""))
        return self.outer[hit]

    def in_box(self, on: Any) -> np.ndarray:
        """Indices of the faces in a box."""
        corners, (low, high) = self.corners, np.asarray(on.box, dtype=float)
        if np.any(low > high):  # of probes: those of boundary are judged with the configuration
            self.problems.add(self.path, f"the box's first corner {format_point(low)} is above its second {format_point(high)}",
                              "the lower corner first", "swap the coordinates")
            return np.empty(0, dtype=int)
        outside = np.maximum(np.maximum(low - corners, corners - high), 0)
        hit = self.met(outside.max(axis=1), [0, 1, 2], f"the box {format_point(low)} … {format_point(high)}")
        if not hit.any():
            distance = np.linalg.norm(outside, axis=2)
            flat = int(np.argmin(distance))
            within = int(np.sum((outside == 0).all(axis=2).any(axis=1)))
            self.problems.add(self.path, f"no boundary face has its three nodes in the box {format_point(low)} … {format_point(high)}; " + (
                             f"{within} faces reach into it" if within else
                             f"the nearest boundary node is {distance.min():.6g} away, "
                             f"at {format_point(corners.reshape(-1, 3)[flat])}"),
                         f"a box that holds faces of the boundary; the mesh spans {format_point(corners.min(axis=(0, 1)))} … "
                         f"{format_point(corners.max(axis=(0, 1)))}",
                         "enlarge the box" if within else "move or enlarge the box")
        return self.outer[hit]
