"""Selection by ``on``: faces of a named surface, a plane or a box; volumes and subdomains, their
matter, loads and codes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchestrator.config.blackbox import CodeSettings, entry_path
from orchestrator.errors import KeyPath, Problems, some
from orchestrator.linalg import SAME
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.geometry import format_point
from orchestrator.scene.model import Material, Subdomain
from orchestrator.scene.names import matching, patterns_of, suggestion

# Planes and boxes are met within this share of the mesh's diagonal: digits of the YAML and of
# files. But not where that is
# more than a share of what the tet behind a face measures across: then the next face of a thin part
# is as near.
TOLERANCE, THICKNESS = 1e-6, 0.01


def select(mesh: Mesh, faces: Faces, on: Any, path: KeyPath, problems: Problems) -> np.ndarray:
    """Indices of the faces selected; empty, with a problem, when there are none.

    A plane or a box takes the faces of the outer boundary that have all three nodes in it, see
    ``Outside.met``. A named surface may also lie inside the mesh.
    """
    if isinstance(on, str):
        return _named(mesh, faces, on, path, problems)
    outside = Outside(mesh, faces, path, problems)
    return outside.on_plane(on) if getattr(on, "plane", None) is not None else outside.in_box(on)


def _named(mesh: Mesh, faces: Faces, on: str, path: KeyPath, problems: Problems) -> np.ndarray:
    names = matching(on, mesh.surfaces)
    if not names:
        volume = ", only a volume" if matching(on, mesh.volumes) else ""
        problems.add(path, f"no surface is called {on!r}{volume}",
                     "the name of a surface of the mesh, shell wildcards allowed, or {plane: x, "
                     "at: 0}, or {box: [[0, 0, 0], [1, 1, 1]]}",
                     suggestion(on, mesh.surfaces, "surface; select a plane or a box instead")
                     if not mesh.surfaces else suggestion(on, mesh.surfaces, "surface"))
        return np.empty(0, dtype=int)
    triangles = np.concatenate([mesh.surfaces[name] for name in names])
    if not len(triangles):
        problems.add(path, f"{on!r} is a surface without triangles on the tets",
                     "a surface that has some",
                     "put faces of the body in the group and save them with the mesh, or select a "
                     "plane or a box")
    found = faces.find(triangles)
    if (found < 0).any():
        bad = triangles[np.flatnonzero(found < 0)[0]]
        problems.add(path,
                     f"{np.sum(found < 0)} of {len(triangles)} triangles of {on!r} are no faces of "
                     f"tets, the first at {format_point(mesh.nodes[bad].mean(axis=0))}",
                     "triangles that are faces of tets",
                     "mesh the surface and the volume together")
    return np.unique(found[found >= 0])


class Outside:
    """The outer boundary of a mesh, of which an ``on`` at a path of the YAML means some faces."""

    def __init__(self, mesh: Mesh, faces: Faces, path: KeyPath, problems: Problems):
        self.mesh, self.faces, self.path, self.problems = mesh, faces, path, problems
        self.outer = faces.outer
        self.corners = mesh.nodes[faces.triangles[self.outer]]

    def met(self, away: np.ndarray, axes: list[int], what: str) -> np.ndarray:
        """(k,) bool, the outer faces that a plane or a box takes: those that it meets but for
        digits.

        Faces of thin parts may be as near as that without being meant. Where some faces are met
        exactly, those are left out that are off by a share of what these are thick; where none is,
        and others are left out, nobody knows which are meant.

        away : (k, a) how far nodes of theirs are off, at most, along the ``axes``
        what : the plane or the box, for messages
        """
        mesh, size = self.mesh, self.mesh.diagonal
        near = np.flatnonzero((away <= TOLERANCE * size).all(axis=1))
        off, across = away[near].max(axis=1), np.ptp(
            mesh.nodes[mesh.cells[self.faces.owner[self.outer[near]], :4]], axis=1)[:, axes]
        taken = (away[near] <= np.maximum(THICKNESS * across, SAME * size)).all(axis=1)
        exact = off <= SAME * size
        if exact.any():
            taken &= exact | (off <= THICKNESS * np.median(across[exact].min(axis=1)))
        elif taken.any() and not taken.all():
            self.problems.add(self.path,
                              f"{what} meets no face exactly; some are up to "
                              f"{off[taken].max():.3g} off, as are others of thin parts, by up to "
                              f"{off[~taken].max():.3g}",
                              "the coordinates of the faces that are meant",
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
            self.problems.add(self.path,
                              f"no boundary face lies on the plane {on.plane} = {on.at:g}; the "
                              f"nearest boundary node is {distance.min():.6g} away, at {on.plane} "
                              f"= {nearest:.6g}",
                         f"a plane that holds faces of the boundary; the mesh spans {on.plane} "
                              f"from {along.min():.6g} to {along.max():.6g}",
                              f"set at: to the {on.plane} of a flat side of the mesh" + (
                             "; if the unit of length differs, set scale: under mesh:"
                             if not along.min() <= on.at <= along.max() else ""))
        return self.outer[hit]

    def in_box(self, on: Any) -> np.ndarray:
        """Indices of the faces in a box."""
        corners, (low, high) = self.corners, np.asarray(on.box, dtype=float)
        if np.any(low > high):  # of probes: those of boundary are judged with the configuration
            self.problems.add(self.path,
                              f"the box's first corner {format_point(low)} is above its second "
                              f"{format_point(high)}",
                              "the lower corner first", "swap the coordinates")
            return np.empty(0, dtype=int)
        outside = np.maximum(np.maximum(low - corners, corners - high), 0)
        hit = self.met(outside.max(axis=1), [0, 1, 2],
                       f"the box {format_point(low)} … {format_point(high)}")
        if not hit.any():
            distance = np.linalg.norm(outside, axis=2)
            flat = int(np.argmin(distance))
            within = int(np.sum((outside == 0).all(axis=2).any(axis=1)))
            self.problems.add(self.path,
                              "no boundary face has its three nodes in the box "
                              f"{format_point(low)} … {format_point(high)}; " + (
                             f"{within} faces reach into it" if within else
                             f"the nearest boundary node is {distance.min():.6g} away, "
                             f"at {format_point(corners.reshape(-1, 3)[flat])}"),
                              "a box that holds faces of the boundary; the mesh spans "
                              f"{format_point(corners.min(axis=(0, 1)))} … "
                              f"{format_point(corners.max(axis=(0, 1)))}",
                              "enlarge the box" if within else "move or enlarge the box")
        return self.outer[hit]


def assign_materials(mesh: Mesh, entries: list[Any],
                     problems: Problems) -> tuple[list[Material], np.ndarray]:
    """The materials and, per tet, (m,) int which one; of several that match, the last wins."""
    chosen = np.full(len(mesh.volumes), -1)
    for i, entry in enumerate(entries):
        chosen[volumes_named(mesh, entry.on, ("materials", i, "on"), problems)] = i
    materials = [Material(float(e.young), float(e.poisson), float(e.expansion or 0.0))
                 for e in entries]
    own = {name for e in entries if getattr(e, "on", None) is not None
           for name in patterns_of(e.on)}
    for stand in mesh.foreign:
        # what it tells of itself, unless it is named
        if stand.matter is not None and mesh.volumes[stand.volume] not in own:
            chosen[stand.volume] = len(materials)
            materials.append(Material(*stand.matter))
    without = [name for name, material in zip(mesh.volumes, chosen) if material < 0]
    if without:
        problems.add(("materials",), f"no material for {some(without, 8)}",
                     "a material for each volume",
                     'name these volumes under on:, or begin the list with a material '
                     'without on:, which holds for all')
    return materials, chosen[mesh.volume]


def volumes_named(mesh: Mesh, on: Any, path: tuple[str | int, ...],
                  problems: Problems) -> list[int]:
    """Indices of the volumes an ``on`` entry names; a name that matches none is a problem."""
    found: dict[int, None] = {}
    for pattern in patterns_of(on):
        names = matching(pattern, mesh.volumes)
        if not names:
            problems.add(path, f"no volume is called {pattern!r}",
                         "names of volumes, shell wildcards allowed",
                         suggestion(pattern, mesh.volumes, "volume"))
        found.update(dict.fromkeys(mesh.volumes.index(name) for name in names))
    return list(found)


def cells_loaded(mesh: Mesh, on: Any, path: tuple[str | int, ...],
                 problems: Problems) -> np.ndarray:
    """(k,) int, cells of the volumes that a load names; parts whose mesh is not ours bring their
    loads along.
    """
    cells = np.flatnonzero(np.isin(mesh.volume, volumes_named(mesh, on, path, problems)))
    if not mesh.foreign:
        return cells
    foreign = mesh.is_foreign(cells)
    if len(cells) and foreign.all():
        problems.add(path,
                     f"a load on {mesh.volumes[mesh.volume[cells[0]]]!r} alone, whose mesh is not "
                     "this program's",
                     "loads on parts with a mesh", "put it in the part's own loads")
    return cells[~foreign]


def assign_codes(mesh: Mesh, subdomains: list[Subdomain], entries: Sequence[CodeSettings]) -> None:
    """Give every subdomain the index of the last entry that matches its name or that of the volume
    it is in.

    Raises InputError: an entry that matches nothing, a subdomain that none matches
    """
    problems, chosen = Problems(), np.full(len(subdomains), -1)
    names = [_names(mesh, s) for s in subdomains]
    known = [name for own in names for name in own]
    for i, entry in enumerate(entries):
        for pattern in entry.on:
            meant = set(matching(pattern, known))
            hit = [not meant.isdisjoint(own) for own in names]
            if not any(hit):
                problems.add((*entry_path(i, entries), "on"),
                             f"no subdomain and no volume is called {pattern!r}",
                             "names of subdomains, shell wildcards allowed",
                             suggestion(pattern, known, "subdomain"))
            chosen[hit] = i
    left = [s.name for s, code in zip(subdomains, chosen) if code < 0]
    if left:
        problems.add(("blackbox",), f"no entry for {some(left, 8)}",
                     "a black box for each subdomain",
                     "begin the list with an entry without on:, which holds for all")
    problems.raise_if_any()
    for subdomain, code in zip(subdomains, chosen.tolist()):
        subdomain.code, subdomain.remembers = code, entries[code].remembers


def _names(mesh: Mesh, subdomain: Subdomain) -> list[str]:
    """Names of a subdomain: its own name and, if it lies in one volume, that volume's."""
    inside = np.unique(mesh.volume[subdomain.cells])
    return [subdomain.name] + ([mesh.volumes[inside[0]]] if len(inside) == 1 else [])
