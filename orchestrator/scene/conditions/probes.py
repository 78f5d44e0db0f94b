"""Places of probes: points and paths found in their tets, surfaces in their faces, sections between tets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.config.base import unit
from orchestrator.config.probes import PathProbe, PointProbe, SectionProbe
from orchestrator.errors import KeyPath, Problems, some
from orchestrator.parallel.team import ALONE, Team
from orchestrator.scene.conditions.selection import select
from orchestrator.scene.mesh.faces import Faces, components
from orchestrator.scene.mesh.geometry import area_vectors, barycentric, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Interface, ends_of
from orchestrator.scene.names import matching, suggestion

# A point counts as in a tet that it is outside of by rounding, in barycentric coordinates.
INSIDE = 1e-9
# On curved faces a point of the true surface lies beside the facets: taken to the nearest one within this share of the
# element's size, which facets of 40 degrees reach.
BESIDE = 0.1


@dataclass(frozen=True)
class Point:
    """A probe at a point: its place in the body, the tet that has it, its barycentric coordinates (4,) there, whose tet it is."""

    name: str
    quantity: str
    at: np.ndarray
    cell: int
    weights: np.ndarray
    subdomains: np.ndarray


@dataclass(frozen=True)
class Surface:
    """A probe on faces.

    quantity : mean, max, min or resultant; of : displacement or stress
    triangles : (k, 3 or 6) int, global nodes, outward of ``cells`` (k,), whose fields are meant
    area : (k, 3) area vectors
    about : (3,) what moments are about
    within : numbers of the volumes that a resultant is confined to; none: of all around
    subdomains : whose the tets are
    """

    name: str
    quantity: str
    of: str
    triangles: np.ndarray
    cells: np.ndarray
    area: np.ndarray
    about: np.ndarray
    within: np.ndarray
    subdomains: np.ndarray


@dataclass(frozen=True)
class Line:
    """A probe along a line.

    at : (n, 3) places; distance : (n,) from the first
    cells : (n,) int, the tet that has each, −1 where none does; weights : (n, 4) barycentric coordinates there
    subdomains : whose the tets are
    """

    name: str
    quantity: str
    at: np.ndarray
    distance: np.ndarray
    cells: np.ndarray
    weights: np.ndarray
    subdomains: np.ndarray


@dataclass(frozen=True)
class Section:
    """A probe across a plane, between tets in front of it and tets behind it.

    front, behind : (k,) int, the tets of the parts that are cut
    normal : (3,) unit vector, to the front; level : of the plane along it; about : (3,) what moments are about
    """

    name: str
    front: np.ndarray
    behind: np.ndarray
    normal: np.ndarray
    level: float
    about: np.ndarray
    quantity: str = "section"


@dataclass(frozen=True)
class Tets:
    """Tets that have a point: numbers (k,), ascending, barycentric coordinates (k, 4) there, volumes and subdomains (k,).

    place : (3,) the point, or the nearest one in the tet; away : how far that is, 0 inside; within : whether that is near
    """

    number: np.ndarray
    weights: np.ndarray
    volume: np.ndarray
    subdomain: np.ndarray
    place: np.ndarray
    away: float
    within: bool

    @classmethod
    def joined(cls, several: Sequence[Tets]) -> Tets:
        """Those of all ranks that are nearest; beside a surface the first of them, and none where it is not near."""
        found = [tets for tets in several if len(tets.number)] or several[:1]
        least = min(tets.away for tets in found)
        first = min((tets for tets in found if tets.away == least), key=lambda tets: tets.number.min(initial=0))
        found = [tets for tets in found if tets.away == 0] or [first]
        whole = [np.concatenate([getattr(tets, name) for tets in found]) for name in ("number", "weights", "volume", "subdomain")]
        order = np.argsort(whole[0])[: len(whole[0]) if first.within else 0]
        return cls(*(values[order] for values in whole), first.place, least, first.within)


@dataclass(frozen=True)
class Finder:
    """Finds probes on a mesh, or on the parts of it that ranks have, which look for points and paths together.

    subdomain : (m,) int, of each tet; bodies : name of each subdomain's body
    number, own : (m,) int, the tets' numbers in the whole mesh, and bool, which are this rank's; None where this is all of it
    """

    mesh: Mesh
    faces: Faces | None
    subdomain: np.ndarray
    bodies: Sequence[str]
    interfaces: Sequence[Interface]
    problems: Problems
    number: np.ndarray | None = None
    own: np.ndarray | None = None
    team: Team = ALONE

    def find(self, asked: Mapping[str, Any]) -> list[Point | Line | Section | Surface]:
        """The probes that ``output.probes`` asks for, by their names."""
        found = []
        for i, (name, one) in enumerate(asked.items()):
            path = ("output", "probes", i)
            cells = self._cells_of(one.part, (*path, "part"))
            if cells is None:
                continue
            kinds = {PointProbe: self._point, PathProbe: self._path, SectionProbe: self._section}
            made = kinds.get(type(one), self._surface)(one, name, cells, path)
            found += [made] if made else []
        return found

    def _cells_of(self, part: str | None, path: KeyPath) -> np.ndarray | None:
        """(m,) bool, the tets of a part; all where none is named; None, with a problem, where there is none of that name."""
        here = np.ones(len(self.mesh.cells), dtype=bool) if self.own is None else self.own
        if part is None:
            return here
        known = list(dict.fromkeys([*self.mesh.volumes, *self.bodies]))
        meant = matching(part, known)
        volumes, own = (here & np.isin(names, meant)[of] for names, of in (
            (self.mesh.volumes, self.mesh.volume), (self.bodies, self.subdomain)))
        whole, some_have = self.team.max(float(volumes.any()), float(own.any()))
        if not (whole or some_have):
            self.problems.add(path, f"no volume and no body is called {part!r}", "a name of one, shell wildcards allowed",
                              suggestion(part, known, "volume"))
            return None
        return volumes if whole else own

    def _point(self, asked: PointProbe, name: str, allowed: np.ndarray, path: KeyPath) -> Point | None:
        at = np.array(asked.at, dtype=float)
        tets, = self._around(at[None], allowed)
        if len(tets.number):
            names = self._apart(tets)
            if len(names) > 1:
                self.problems.add((*path, "at"), f"{format_point(at)} is where {some(names)} meet: each has values of its own there",
                                 "one part", f"add part: {names[0]}")
                return None
            return Point(name, asked.quantity, tets.place, int(tets.number[0]), tets.weights[0], tets.subdomain[:1])
        if self.mesh.within is not None:
            self.problems.add((*path, "at"), "a point outside", "all of the mesh, to tell what is near")
            return None
        nodes = np.unique(self.mesh.cells[allowed, :4])
        distance = np.linalg.norm(self.mesh.nodes[nodes] - at, axis=1)
        nearest = self.mesh.nodes[nodes[np.argmin(distance)]]
        whose = "the body" if asked.part is None else f"{asked.part!r}"
        self.problems.add((*path, "at"), f"{format_point(at)} is outside {whose}; the nearest node is {distance.min():.6g} away, at "
                     f"{format_point(nearest)}", "a point inside or on the surface",
                     f"take {format_point(nearest)}, or a point between nodes; if the unit of length differs, set scale: under mesh:")
        return None

    def _around(self, points: np.ndarray, allowed: np.ndarray) -> list[Tets]:
        """Tets that have each of some points (n, 3), of all ranks; beside a curved surface the nearest one, farther away none."""
        told = self.team.all_gather([self._here(at, allowed) for at in points])
        return [Tets.joined(each) for each in zip(*told)]

    def _here(self, at: np.ndarray, allowed: np.ndarray) -> Tets:
        """Those of this rank's that have a point, else the nearest."""
        cells, mesh = np.flatnonzero(allowed), self.mesh
        corners = mesh.nodes[mesh.cells[cells, :4]]
        size = np.ptp(corners, axis=1).max(axis=1)
        near = (np.maximum(corners.min(axis=1) - at, at - corners.max(axis=1)).max(axis=1) <= BESIDE * size)
        cells, corners, size = cells[near], corners[near], size[near]
        weights, place, away = barycentric(corners, at), at, np.zeros(len(cells))
        chosen = np.flatnonzero(weights.min(axis=1, initial=np.inf) >= -INSIDE)
        if len(cells) and not len(chosen):
            weights = np.maximum(weights, 0.0)
            weights /= weights.sum(axis=1, keepdims=True)
            places = np.einsum("kax,ka->kx", corners, weights)
            away = np.linalg.norm(places - at, axis=1)
            chosen = away.argmin()[None]
            place = places[chosen[0]]
        within, cells = bool((away[chosen] <= BESIDE * size[chosen]).all()), cells[chosen]
        return Tets(cells if self.number is None else self.number[cells], weights[chosen], mesh.volume[cells], self.subdomain[cells],
                    place, float(away[chosen].max(initial=0.0)), within)

    def _path(self, asked: PathProbe, name: str, allowed: np.ndarray, path: KeyPath) -> Line | None:
        """Points of a path; where parts meet, a point belongs to the one that the path comes from."""
        ends = np.array(asked.along, dtype=float)
        at = ends[0] + np.linspace(0.0, 1.0, asked.points)[:, None] * (ends[1] - ends[0])
        cells, weights, before, of = np.full(len(at), -1), np.zeros((len(at), 4)), None, set()
        for k, tets in enumerate(self._around(at, allowed)):
            if len(tets.number):
                at[k] = tets.place
                same = [] if before is None else np.flatnonzero(tets.subdomain == before)
                best = int(same[0]) if len(same) else 0
                cells[k], weights[k], before = tets.number[best], tets.weights[best], tets.subdomain[best]
                of.add(int(before))
        outside = int((cells < 0).sum())
        if outside == len(at):
            self.problems.add((*path, "along"), f"all points from {format_point(ends[0])} to {format_point(ends[1])} are outside "
                              + ("the body" if asked.part is None else repr(asked.part)), "a line through the body",
                              "look at the coordinates; if the unit of length differs, set scale: under mesh:")
            return None
        if outside:
            self.problems.warnings.append(f"{outside} of the {len(at)} points of {name!r} are outside the body and have no values")
        return Line(name, asked.quantity, at, np.linalg.norm(at - ends[0], axis=1), cells, weights, np.array(sorted(of)))

    def _section(self, asked: SectionProbe, name: str, allowed: np.ndarray, path: KeyPath) -> Section | None:
        mesh, normal, point = self.mesh, np.array(unit(asked.section.plane)), np.array(asked.section.point, dtype=float)
        front = (mesh.nodes[mesh.cells[:, :4]].mean(axis=1) - point) @ normal > 0
        may_part = [i for i in self.interfaces if not (i.law.perfect and i.mortar is None)]
        along = [i.name for i in may_part if _parted(mesh, i.cells, allowed, front).any()]
        if along:
            self.problems.add((*path, "section"), f"the plane runs along {some(along)}, where sides may part", "a plane through matter",
                              "move it by an element; what interfaces carry is in interfaces.csv, bolts have lines of their own")
            return None
        front, behind = np.flatnonzero(front & allowed), np.flatnonzero(~front & allowed)
        if not len(np.intersect1d(mesh.cells[front], mesh.cells[behind])):
            box = mesh.nodes[np.unique(mesh.cells[allowed, :4])]
            self.problems.add((*path, "section"), "no tets have their centres behind the plane, or none before it, of the body from "
                              f"{format_point(box.min(axis=0))} to {format_point(box.max(axis=0))}", "a plane through it",
                              "look at the coordinates, and at part:; near a face move the plane inwards by half an element")
            return None
        return Section(name, front, behind, normal, float(normal @ point), point if asked.about is None else np.array(asked.about, dtype=float))

    def _apart(self, tets: Tets) -> list[str]:
        """Names of what has tets of its own among these: volumes, and bodies that interfaces of one volume may part."""
        volumes = np.unique(tets.volume)
        if len(volumes) > 1:
            return [self.mesh.volumes[v] for v in volumes]
        theirs = np.unique(tets.subdomain)
        bonds = ends_of(i for i in self.interfaces if i.law.perfect)
        held = components(*bonds.T, len(self.bodies))[1][theirs]
        first = theirs[np.unique(held, return_index=True)[1]]
        return list(dict.fromkeys(self.bodies[e] for e in first))

    def _surface(self, asked: Any, name: str, allowed: np.ndarray, path: KeyPath) -> Surface | None:
        chosen = select(self.mesh, self.faces, asked.on, (*path, "on"), self.problems)
        if not len(chosen):
            return None
        triangles, owner, other = self.faces.triangles[chosen], self.faces.owner[chosen], self.faces.neighbour[chosen]
        first, second = allowed[owner], (other >= 0) & allowed[other]
        if not (first | second).any():
            self.problems.add((*path, "part"), f"{asked.part!r} has none of these faces", "a part that has",
                              "name another part, or leave it out")
            return None
        between = first & second & (self.mesh.volume[owner] != self.mesh.volume[other])
        if between.any():
            k = int(np.flatnonzero(between)[0])
            names = [self.mesh.volumes[self.mesh.volume[c]] for c in (owner[k], other[k])]
            self.problems.add((*path, "on"), f"faces between {some(names)}: each has values of its own there", "one part",
                         f"add part: {names[0]}")
            return None
        cells = np.where(first, owner, other)
        kept = first | second
        area = np.where(first, 1.0, -1.0)[:, None] * area_vectors(self.mesh.nodes, triangles)
        triangles, cells, area = triangles[kept], cells[kept], area[kept]
        each = np.linalg.norm(area, axis=1)
        centre = each @ self.mesh.nodes[triangles[:, :3]].mean(axis=1) / each.sum()
        about = centre if asked.about is None else np.array(asked.about, dtype=float)
        within = np.unique(self.mesh.volume[cells]) if asked.part is not None else np.empty(0, int)
        return Surface(name, asked.quantity, asked.of or "displacement", triangles, cells, area, about, within,
                       np.unique(self.subdomain[cells]))


def _parted(mesh: Mesh, cells: np.ndarray, allowed: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Bool for each face between two tets (k, 2) of the mesh: they are of one volume, one in front of a plane and the other behind it."""
    cells = cells[((cells >= 0) & (cells < len(allowed))).all(axis=1)]  # a ground's are beyond the mesh's
    first, second = cells.T
    return allowed[first] & allowed[second] & (mesh.volume[first] == mesh.volume[second]) & (front[first] != front[second])
