"""Kinds of probes over faces and across sections. A part of a scene has what is on its own
cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from orchestrator.config.base import unit, Vector
from orchestrator.config.boundary import Cut, Where
from orchestrator.config.conditions import ProbeEntry, Quantity
from orchestrator.errors import InputError, some
from orchestrator.scene.conditions.probes import Probe
from orchestrator.scene.conditions.selection import select
from orchestrator.scene.mesh.geometry import area_vectors, format_point
from orchestrator.scene.mesh.mesh import Mesh


class SurfaceProbe(ProbeEntry):
    """A value over faces: the mean, an extreme with its place, or the resultant of all that acts on
    them.
    """

    on: Where = Field(description="a surface group (shell wildcards allowed), a plane or a box")
    quantity: Literal["mean", "max", "min", "resultant"] = Field("mean", description=(
        "mean: by area; max, min: of every component, with its place; resultant: force and moment "
        "that act on the faces"))
    of: Quantity | None = Field(None,
                                description="what the mean or extreme is of: displacement, as "
                                "where nothing is said, or stress")
    about: Vector | None = Field(None,
                                 description="the moment of a resultant is about this point; none: "
                                 "the surface's centre")

    def found(self, finder: Any) -> ProbeSurface:
        mesh, allowed = finder.mesh, finder.cells
        chosen = select(mesh, finder.faces, self.on, (*finder.path, "on"), finder.problems)
        if not len(chosen):
            raise InputError([])  # told there
        triangles, owner, other = finder.faces.triangles[chosen], finder.faces.owner[
            chosen], finder.faces.neighbour[chosen]
        first, second = allowed[owner], (other >= 0) & allowed[other]
        if not (first | second).any():
            raise finder.wrong("part", f"{self.part!r} has none of these faces",
                               "a part that has",
                               "name another part, or leave it out")
        between = first & second & (mesh.volume[owner] != mesh.volume[other])
        if between.any():
            k = int(np.flatnonzero(between)[0])
            names = [mesh.volumes[mesh.volume[c]] for c in (owner[k], other[k])]
            raise finder.wrong("on",
                               f"faces between {some(names)}: each has values of its own there",
                               "one part",
                               f"add part: {names[0]}")
        cells = np.where(first, owner, other)
        kept = first | second
        area = np.where(first, 1.0, -1.0)[:, None] * area_vectors(mesh.nodes, triangles)
        triangles, cells, area = triangles[kept], cells[kept], area[kept]
        each = np.linalg.norm(area, axis=1)
        total = float(each.sum())
        centre = each @ mesh.nodes[triangles[:, :3]].mean(axis=1) / total
        within = np.unique(mesh.volume[cells]) if self.part is not None else np.empty(0, int)
        corners = (mesh.cells[cells][:, None, :] == triangles[:, :, None]).argmax(axis=2)
        about = centre if self.about is None else np.array(self.about, float)
        of = "force" if self.quantity == "resultant" else self.of or "displacement"
        return ProbeSurface(finder.name, self.quantity, of, cells, corners, area,
                            total, centre, about, within,
                            np.unique(finder.subdomain[cells]))


@dataclass(frozen=True)
class ProbeSurface(Probe):
    """A probe on faces.

    quantity : mean, max, min or resultant; of : displacement, stress, or force of a resultant
    cells : (k,) int, the tets whose fields are meant; corners : (k, 3 or 6) int, which of their
        nodes each face has
    area : (k, 3) area vectors, outward of these
    total, centre : area and (3,) centre of all faces, also where these are some of them
    about : (3,) what moments are about
    within : numbers of the volumes that a resultant is confined to; none: of all around
    subdomains : whose the tets are
    """

    name: str
    quantity: str
    of: str
    cells: np.ndarray
    corners: np.ndarray
    area: np.ndarray
    total: float
    centre: np.ndarray
    about: np.ndarray
    within: np.ndarray
    subdomains: np.ndarray

    def triangles(self, cells: np.ndarray) -> np.ndarray:
        """(k, 3 or 6) int, nodes of the faces, of a mesh's tets (m, 4 or 10)."""
        return cells[self.cells[:, None], self.corners]

    @property
    def at(self) -> np.ndarray:
        return self.about if self.of == "force" else self.centre

    def told(self, reader: Any) -> tuple:
        return (reader.force if self.of == "force" else reader.over)(self)


class SectionProbe(ProbeEntry):
    """Force and moment that matter carries across a plane: what is in front of it, where the normal
    points, exerts on what is behind.
    """

    section: Cut = Field(
        description="the plane: {plane: z, at: 12}, or {plane: [0, 1, 1], at: [0, 5, 5]}")
    about: Vector | None = Field(None,
                                 description="the moment is about this point; none: the plane's "
                                 "point, as at says")

    def found(self, finder: Any) -> ProbeSection:
        mesh, allowed = finder.mesh, finder.cells
        normal, point = np.array(unit(self.section.plane)), np.array(
            self.section.point, float)
        front = (mesh.nodes[mesh.cells[:, :4]].mean(axis=1) - point) @ normal > 0
        may_part = [i for i in finder.interfaces if not (i.law.perfect and i.mortar is None)]
        along = [i.name for i in may_part if _parted(mesh, i.cells, allowed, front).any()]
        if along:
            raise finder.wrong("section",
                               f"the plane runs along {some(along)}, where sides may part",
                               "a plane through matter",
                               "move it by an element; what interfaces carry is in interfaces.csv, "
                               "bolts have lines of their own")
        front, behind = np.flatnonzero(front & allowed), np.flatnonzero(~front & finder.cells)
        if not len(np.intersect1d(mesh.cells[front], mesh.cells[behind])):
            box = mesh.nodes[np.unique(mesh.cells[allowed, :4])]
            raise finder.wrong("section",
                               "no tets have their centres behind the plane, or none before it, of "
                               f"the body from {format_point(box.min(axis=0))} to "
                               f"{format_point(box.max(axis=0))}",
                               "a plane through it",
                               "look at the coordinates, and at part:; near a face move the plane "
                               "inwards by half an element")
        return ProbeSection(finder.name, front, behind, normal, float(normal @ point),
                            point if self.about is None else np.array(self.about, float))


@dataclass(frozen=True)
class ProbeSection(Probe):
    """A probe across a plane, between tets in front of it and tets behind it.

    front, behind : (k,) int, the tets of the parts that are cut; of neighbours of a part those that
        it has
    normal : (3,) unit vector, to the front; level : of the plane along it; about : (3,) what
        moments are about
    """

    name: str
    front: np.ndarray
    behind: np.ndarray
    normal: np.ndarray
    level: float
    about: np.ndarray
    quantity, of = "section", "force"

    @property
    def at(self) -> np.ndarray:
        return self.about

    def told(self, reader: Any) -> tuple:
        names, force = reader.force(self)
        shear = np.linalg.norm(force[:, :3] - force[:, 6:7] * self.normal, axis=1)
        return (*names, "normal", "shear"), np.column_stack([force, shear])


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
