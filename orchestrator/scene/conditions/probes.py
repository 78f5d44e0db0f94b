"""Kinds of probes: what each takes, where it reads on the mesh, what it tells. Here those at points
of tets, which are named by their numbers in the whole mesh, wherever these are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from orchestrator.config.base import Vector
from orchestrator.config.conditions import ProbeEntry, Quantity
from orchestrator.errors import some
from orchestrator.scene.mesh.geometry import format_point


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
