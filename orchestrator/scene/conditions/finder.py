"""Finds what probes read on a mesh: points and paths in their tets, surfaces in their faces,
sections between tets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import unit
from orchestrator.config.probes import PathProbe, PointProbe, SectionProbe, SurfaceProbe
from orchestrator.errors import InputError, KeyPath, Problems, some, wrong
from orchestrator.scene.conditions.probes import (
    ProbeLine, ProbePoint, ProbeSection, ProbeSurface, Tets)
from orchestrator.scene.conditions.selection import select
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.geometry import area_vectors, barycentric, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.interface import Interface, ends_of
from orchestrator.scene.names import matching, suggestion

# A point counts as in a tet that it is outside of by rounding, in barycentric coordinates.
INSIDE = 1e-9
# On curved faces a point of the true surface lies beside the facets: taken to the nearest one
# within this share of the
# element's size, which facets of 40 degrees reach.
BESIDE = 0.1


@dataclass(frozen=True)
class Finder:
    """Finds probes on a mesh.

    subdomain : (m,) int, of each tet; bodies : name of each subdomain's body
    """

    mesh: Mesh
    faces: Faces | None
    subdomain: np.ndarray
    bodies: Sequence[str]
    interfaces: Sequence[Interface]
    problems: Problems

    def find(self, asked: Mapping[str, Any]) -> list[ProbePoint | ProbeLine | ProbeSection
                                                     | ProbeSurface]:
        """The probes that ``output.probes`` asks for, by their names."""
        found = []
        for i, (name, one) in enumerate(asked.items()):
            path = ("output", "probes", i)
            find = {PointProbe: self._point, PathProbe: self._path, SectionProbe: self._section,
                    SurfaceProbe: self._surface}[type(one)]
            try:
                found.append(find(one, name, self._cells_of(one.part, (*path, "part")), path))
            except InputError as error:
                self.problems.found += error.problems
        return found

    def _cells_of(self, part: str | None, path: KeyPath) -> np.ndarray:
        """(m,) bool, the tets of a part; all where none is named.

        Raises InputError: there is none of that name
        """
        if part is None:
            return np.ones(len(self.mesh.cells), bool)
        if volumes := matching(part, self.mesh.volumes):
            return np.isin(self.mesh.volumes, volumes)[self.mesh.volume]
        own = np.isin(self.bodies, matching(part, self.bodies))[self.subdomain]
        if not own.any():
            raise wrong(path, f"no volume and no body is called {part!r}",
                        "a name of one, shell wildcards allowed",
                        suggestion(part,
                                   list(dict.fromkeys([*self.mesh.volumes, *self.bodies])),
                                   "volume"))
        return own

    def _point(self, asked: PointProbe, name: str, allowed: np.ndarray,
               path: KeyPath) -> ProbePoint:
        at = np.array(asked.at, float)
        tets = self.around(at, allowed)
        if len(tets.number):
            names = self._apart(tets)
            if len(names) > 1:
                raise wrong((*path, "at"),
                            f"{format_point(at)} is where {some(names)} meet: each has "
                            "values of its own there",
                            "one part", f"add part: {names[0]}")
            return ProbePoint(name, asked.quantity, tets.place, int(tets.number[0]),
                              tets.weights[0], tets.subdomain[:1])
        nodes = np.unique(self.mesh.cells[allowed, :4])
        distance = np.linalg.norm(self.mesh.nodes[nodes] - at, axis=1)
        nearest = self.mesh.nodes[nodes[np.argmin(distance)]]
        whose = "the body" if asked.part is None else f"{asked.part!r}"
        raise wrong((*path, "at"),
                    f"{format_point(at)} is outside {whose}; the nearest node is "
                    f"{distance.min():.6g} away, at "
                    f"{format_point(nearest)}", "a point inside or on the surface",
                    f"take {format_point(nearest)}, or a point between nodes; if the unit of "
                    "length differs, set scale: under mesh:")

    def around(self, at: np.ndarray, allowed: np.ndarray) -> Tets:
        """Return tets that have a point; beside a curved surface the nearest one, farther away
        none.
        """
        cells, mesh = np.flatnonzero(allowed), self.mesh
        corners = mesh.nodes[mesh.cells[cells, :4]]
        size = np.ptp(corners, axis=1).max(axis=1)
        near = (np.maximum(corners.min(axis=1) - at, at - corners.max(axis=1)).max(axis=1) <= BESIDE
                * size)
        cells, corners, size = cells[near], corners[near], size[near]
        weights, place = barycentric(corners, at), at
        chosen = np.flatnonzero(weights.min(axis=1, initial=np.inf) >= -INSIDE)
        if len(cells) and not len(chosen):
            weights = np.maximum(weights, 0.0)
            weights /= weights.sum(axis=1, keepdims=True)
            places = np.einsum("kax,ka->kx", corners, weights)
            away = np.linalg.norm(places - at, axis=1)
            chosen = away.argmin()[None]
            place = places[chosen[0]]
            chosen = chosen[away[chosen] <= BESIDE * size[chosen]]
        cells = cells[chosen]
        return Tets(cells, weights[chosen], mesh.volume[cells], self.subdomain[cells], place)

    def _path(self, asked: PathProbe, name: str, allowed: np.ndarray,
              path: KeyPath) -> ProbeLine:
        """Points of a path; where parts meet, a point belongs to the one that the path comes
        from.
        """
        ends = np.array(asked.along, float)
        at = ends[0] + np.linspace(0.0, 1.0, asked.points)[:, None] * (ends[1] - ends[0])
        cells, weights, before, of = np.full(len(at), -1), np.zeros((len(at), 4)), None, set()
        for k, point in enumerate(at.copy()):
            tets = self.around(point, allowed)
            if len(tets.number):
                at[k] = tets.place
                same = [] if before is None else np.flatnonzero(tets.subdomain == before)
                best = int(same[0]) if len(same) else 0
                cells[k], weights[k], before = tets.number[best], tets.weights[
                    best], tets.subdomain[best]
                of.add(int(before))
        outside = int((cells < 0).sum())
        if outside == len(at):
            raise wrong((*path, "along"),
                        f"all points from {format_point(ends[0])} to "
                        f"{format_point(ends[1])} are outside "
                        + ("the body" if asked.part is None else repr(asked.part)),
                        "a line through the body",
                        "look at the coordinates; if the unit of length differs, set scale: "
                        "under mesh:")
        if outside:
            self.problems.warnings.append(
                f"{outside} of the {len(at)} points of {name!r} are outside the body and have no "
                "values")
        return ProbeLine(name, asked.quantity, at, np.linalg.norm(at - ends[0], axis=1), cells,
                         weights, np.array(sorted(of)))

    def _section(self, asked: SectionProbe, name: str, allowed: np.ndarray,
                 path: KeyPath) -> ProbeSection:
        mesh, normal, point = self.mesh, np.array(unit(asked.section.plane)), np.array(
            asked.section.point, float)
        front = (mesh.nodes[mesh.cells[:, :4]].mean(axis=1) - point) @ normal > 0
        may_part = [i for i in self.interfaces if not (i.law.perfect and i.mortar is None)]
        along = [i.name for i in may_part if _parted(mesh, i.cells, allowed, front).any()]
        if along:
            raise wrong((*path, "section"),
                        f"the plane runs along {some(along)}, where sides may part",
                        "a plane through matter",
                        "move it by an element; what interfaces carry is in interfaces.csv, "
                        "bolts have lines of their own")
        front, behind = np.flatnonzero(front & allowed), np.flatnonzero(~front & allowed)
        if not len(np.intersect1d(mesh.cells[front], mesh.cells[behind])):
            box = mesh.nodes[np.unique(mesh.cells[allowed, :4])]
            raise wrong((*path, "section"),
                        "no tets have their centres behind the plane, or none before it, of "
                        f"the body from {format_point(box.min(axis=0))} to "
                        f"{format_point(box.max(axis=0))}",
                        "a plane through it",
                        "look at the coordinates, and at part:; near a face move the plane "
                        "inwards by half an element")
        return ProbeSection(name, front, behind, normal, float(normal @ point),
                            point if asked.about is None else np.array(asked.about, float))

    def _apart(self, tets: Tets) -> list[str]:
        """Names of what has tets of its own among these: volumes, and bodies that interfaces of one
        volume may part.
        """
        volumes = np.unique(tets.volume)
        if len(volumes) > 1:
            return [self.mesh.volumes[v] for v in volumes]
        theirs = np.unique(tets.subdomain)
        bonds = ends_of(i for i in self.interfaces if i.law.perfect)
        held = components(*bonds.T, len(self.bodies))[1][theirs]
        first = theirs[np.unique(held, return_index=True)[1]]
        return list(dict.fromkeys(self.bodies[e] for e in first))

    def _surface(self, asked: Any, name: str, allowed: np.ndarray,
                 path: KeyPath) -> ProbeSurface:
        chosen = select(self.mesh, self.faces, asked.on, (*path, "on"), self.problems)
        if not len(chosen):
            raise InputError([])  # told there
        triangles, owner, other = self.faces.triangles[chosen], self.faces.owner[
            chosen], self.faces.neighbour[chosen]
        first, second = allowed[owner], (other >= 0) & allowed[other]
        if not (first | second).any():
            raise wrong((*path, "part"), f"{asked.part!r} has none of these faces",
                        "a part that has",
                        "name another part, or leave it out")
        between = first & second & (self.mesh.volume[owner] != self.mesh.volume[other])
        if between.any():
            k = int(np.flatnonzero(between)[0])
            names = [self.mesh.volumes[self.mesh.volume[c]] for c in (owner[k], other[k])]
            raise wrong((*path, "on"),
                        f"faces between {some(names)}: each has values of its own there",
                        "one part",
                        f"add part: {names[0]}")
        cells = np.where(first, owner, other)
        kept = first | second
        area = np.where(first, 1.0, -1.0)[:, None] * area_vectors(self.mesh.nodes, triangles)
        triangles, cells, area = triangles[kept], cells[kept], area[kept]
        each = np.linalg.norm(area, axis=1)
        total = float(each.sum())
        centre = each @ self.mesh.nodes[triangles[:, :3]].mean(axis=1) / total
        within = np.unique(self.mesh.volume[cells]) if asked.part is not None else np.empty(0, int)
        corners = (self.mesh.cells[cells][:, None, :] == triangles[:, :, None]).argmax(axis=2)
        about = centre if asked.about is None else np.array(asked.about, float)
        return ProbeSurface(name, asked.quantity, asked.of or "displacement", cells, corners, area,
                            total, centre, about, within,
                            np.unique(self.subdomain[cells]))


def _parted(mesh: Mesh, cells: np.ndarray, allowed: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Bool for each face between two tets (k, 2) of the mesh: they are of one volume, one in front
    of a plane and the other behind it.
    """
    # a ground's are beyond the mesh's
    cells = cells[((cells >= 0) & (cells < len(allowed))).all(axis=1)]
    first, second = cells.T
    return allowed[first] & allowed[second] & (mesh.volume[first]
                                               == mesh.volume[second]) & (
                                                   front[first] != front[second])
