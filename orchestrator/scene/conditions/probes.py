"""Places that probes read: points and lines in their tets, surfaces by their faces, sections
between tets.

Points and lines name tets by their numbers in the whole mesh, wherever these are. Of surfaces and
sections a part of a scene has what is on its own cells: ``of_part``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ProbePoint:
    """A probe at a point: its place in the body, the tet that has it, its barycentric coordinates
    (4,) there, whose tet it is.
    """

    name: str
    quantity: str
    at: np.ndarray
    cell: int
    weights: np.ndarray
    subdomains: np.ndarray


@dataclass(frozen=True)
class ProbeSurface:
    """A probe on faces.

    quantity : mean, max, min or resultant; of : displacement or stress
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

@dataclass(frozen=True)
class ProbeLine:
    """A probe along a line.

    at : (n, 3) places; distance : (n,) from the first
    cells : (n,) int, the tet that has each, −1 where none does; weights : (n, 4) barycentric
        coordinates there
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
class ProbeSection:
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
    quantity: str = "section"

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
