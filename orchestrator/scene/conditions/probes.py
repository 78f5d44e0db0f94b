"""Kinds of probes: what each takes, where it reads on the mesh, what it tells. Here those at points
of tets, which are named by their numbers in the whole mesh, wherever these are.

Finds what probes read on a mesh: the tets of a part, those that have a point, and what is parted
there. Where a kind reads it finds itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Vector
from orchestrator.config.conditions import ProbeEntry, Quantity
from orchestrator.errors import InputError, KeyPath, Problems, some, wrong
from orchestrator.linalg import PLACED
from orchestrator.scene.interface import ends_of, Interface
from orchestrator.scene.mesh.faces import components, Faces
from orchestrator.scene.mesh.geometry import barycentric, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import matching, suggestion


class Probe:
    """A probe in its place, which its entry has ``found``.

    name : in the results; quantity, of : what it tells: a point, a mean; of displacement, stress,
        or force: what matter carries, by ``method.delivery.flux``
    at : (3,) its point, centre or what moments are about; or (n, 3) along a path
    path : whether it is one, for paths.csv, with the ``distance`` (n,) along it
    subdomains : whose displacements it tells
    """

    path = False

    def told(self, reader: Any) -> tuple:
        """Return names of components, their values (T, components), along a path (T, n,
        components), and of extremes the places (T, components, 3).

        reader : a ``results.probes.Reader``
        """
        raise NotImplementedError


class Pointwise(ProbeEntry):
    """Values at points of the undeformed body."""

    quantity: Quantity = Field("displacement",
                               description="displacement, or the stress at the nodes, linear "
                               "between them")


class PointProbe(Pointwise):
    """A value at a point of the undeformed body."""

    at: Vector = Field(description="the point, in the undeformed body")

    def found(self, finder: Any) -> ProbePoints:
        at = np.array(self.at, float)
        tets = finder.around(at, finder.cells)
        if len(tets.number):
            names = finder.apart(tets)
            if len(names) > 1:
                raise finder.wrong("at",
                                   f"{format_point(at)} is where {some(names)} meet: each has "
                                   "values of its own there",
                                   "one part", f"add part: {names[0]}")
            return ProbePoints(finder.name, self.quantity, tets.place, tets.number[:1],
                               tets.weights[:1], tets.subdomain[:1])
        nodes = np.unique(finder.mesh.cells[finder.cells, :4])
        distance = np.linalg.norm(finder.mesh.nodes[nodes] - at, axis=1)
        nearest = finder.mesh.nodes[nodes[np.argmin(distance)]]
        whose = "the body" if self.part is None else f"{self.part!r}"
        raise finder.wrong("at", f"{format_point(at)} is outside {whose}; the nearest node is "
                           f"{distance.min():.6g} away, at "
                           f"{format_point(nearest)}", "a point inside or on the surface",
                           f"take {format_point(nearest)}, or a point between nodes; if the unit "
                           "of length differs, set scale: under mesh:")


class PathProbe(Pointwise):
    """Values along a straight line through the undeformed body, into paths.csv."""

    along: Annotated[list[Vector],
                     Field(min_length=2, max_length=2)] = Field(
                         description="the line's ends: [[x, y, z], [x, y, z]]")
    points: Annotated[int, Field(ge=2, le=1000)] = Field(21, description=(
        "how many points, evenly spaced, ends included; twenty intervals show what a few elements "
        "resolve"))

    def found(self, finder: Any) -> ProbePoints:
        """Points of a path; where parts meet, a point belongs to the one that the path comes
        from.
        """
        ends = np.array(self.along, float)
        at = ends[0] + np.linspace(0.0, 1.0, self.points)[:, None] * (ends[1] - ends[0])
        cells, weights, before, of = np.full(len(at), -1), np.zeros((len(at), 4)), None, set()
        for k, point in enumerate(at.copy()):
            tets = finder.around(point, finder.cells)
            if len(tets.number):
                at[k] = tets.place
                same = [] if before is None else np.flatnonzero(tets.subdomain == before)
                best = int(same[0]) if len(same) else 0
                cells[k], weights[k], before = tets.number[best], tets.weights[
                    best], tets.subdomain[best]
                of.add(int(before))
        outside = int((cells < 0).sum())
        if outside == len(at):
            raise finder.wrong("along", f"all points from {format_point(ends[0])} to "
                               f"{format_point(ends[1])} are outside "
                               + ("the body" if self.part is None else repr(self.part)),
                               "a line through the body",
                               "look at the coordinates; if the unit of length differs, set scale: "
                               "under mesh:")
        if outside:
            finder.problems.warnings.append(
                f"{outside} of the {len(at)} points of {finder.name!r} are outside the body and "
                "have no values")
        return ProbePoints(finder.name, self.quantity, at, cells, weights, np.array(sorted(of)),
                           np.linalg.norm(at - ends[0], axis=1))


@dataclass(frozen=True)
class ProbePoints(Probe):
    """A probe at a point, or along a line.

    at : (3,), or (n, 3) places; distance : (n,) from the first, None of a point
    cells : (n,) int, the tet that has each, −1 where none does; weights : (n, 4) barycentric
        coordinates there
    subdomains : whose the tets are
    """

    name: str
    of: str
    at: np.ndarray
    cells: np.ndarray
    weights: np.ndarray
    subdomains: np.ndarray
    distance: np.ndarray | None = None
    quantity = "point"

    @property
    def path(self) -> bool:
        return self.distance is not None

    def told(self, reader: Any) -> tuple:
        names, values = reader.at(self.of, self.cells, self.weights)
        return names, values if self.path else values[:, 0]


# On curved faces a point of the true surface lies beside the facets: taken to the nearest one
# within this share of the
# element's size, which facets of 40 degrees reach.
BESIDE = 0.1


@dataclass(frozen=True)
class Tets:
    """Tets that have a point: numbers (k,), ascending, barycentric coordinates (k, 4) there,
    volumes and subdomains (k,).

    place : (3,) the point, or the nearest one in the tet
    """

    number: np.ndarray
    weights: np.ndarray
    volume: np.ndarray
    subdomain: np.ndarray
    place: np.ndarray


@dataclass(frozen=True)
class Finder:
    """Finds probes on a mesh.

    subdomain : (m,) int, of each tet; bodies : name of each subdomain's body
    name, cells, path : of the probe that is looked for; (m,) bool, the tets that are meant; its
        place in the YAML
    """

    mesh: Mesh
    faces: Faces | None
    subdomain: np.ndarray
    bodies: Sequence[str]
    interfaces: Sequence[Interface]
    problems: Problems
    name: str = ""
    cells: np.ndarray | None = None
    path: KeyPath = ()

    def find(self, asked: Mapping[str, Any]) -> list[Any]:
        """Return what ``output.probes`` asks for, by their names."""
        found = []
        for i, (name, one) in enumerate(asked.items()):
            path = ("output", "probes", i)
            try:
                cells = self._cells_of(one.part, (*path, "part"))
                found.append(one.found(replace(self, name=name, cells=cells, path=path)))
            except InputError as error:
                self.problems.found += error.problems
        return found

    def wrong(self, key: str, *why: str) -> InputError:
        """The error to raise for a key of the probe."""
        return wrong((*self.path, key), *why)

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
        chosen = np.flatnonzero(weights.min(axis=1, initial=np.inf) >= -PLACED)
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

    def apart(self, tets: Tets) -> list[str]:
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
