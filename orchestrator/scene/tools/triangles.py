"""A rigid tool from an STL file: the nearest of its triangles, and the smooth surface that they
stand for.

Triangles that turn little against each other are one smooth face, as on parts: its normals, those
of the cylinder, cone, sphere or torus that its corners lie on where they do, are interpolated, and
it stands off the triangles as these have it turn. At sharp edges the normal is the way from the
nearest point.
"""

from __future__ import annotations

from dataclasses import dataclass

import meshio
import numpy as np
from scipy.spatial import cKDTree

from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.scene.interfaces.skins import Surface as Smooth, over, surface_of
from orchestrator.scene.mesh.geometry import (
    area_vectors, facet_normals, format_point, rounding, unit)
from orchestrator.scene.mesh.quadratic import TRIANGLE_EDGES, edges_of
from orchestrator.scene.tools.motion import ToolSurface

# a point that is farther than this from straight above a curved face has an edge below it
ASIDE = np.cos(np.deg2rad(30.0))
STRAIGHT = 1e-9  # the same of plane ones: one less its cosine that is rounding
NOTHING = 1e-6  # of a triangle, at which a point has no way to the surface any more


@dataclass(frozen=True)
class TriangulatedSurface(ToolSurface):
    """A closed surface.

    corners : (k, 3, 3) of its triangles, normal : (k, 3) unit
    smooth : what these stand for
    """

    middle: np.ndarray
    corners: np.ndarray
    normal: np.ndarray
    smooth: Smooth

    @classmethod
    def of(cls, points: np.ndarray, triangles: np.ndarray) -> TriangulatedSurface:
        """Surface of triangles (k, 3) int on points (n, 3), outward."""
        smooth = surface_of(points, triangles, np.full(len(triangles), -1))
        return cls((points.min(axis=0) + points.max(axis=0)) / 2, points[triangles],
                   facet_normals(points, triangles)[0], smooth)

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        which, share = self._nearest(points)
        off = points - np.einsum("nv,nvc->nc", share, self.corners[which])
        normal = unit(np.einsum("nv,nvc->nc", share, self.smooth.means[which]))
        far, straight = np.linalg.norm(off, axis=1), np.einsum("nc,nc->n", off, normal)
        distance = straight - over(self.smooth.bulge[which],
                                   share) * np.einsum("nc,nc->n", normal, self.normal[which])
        size = np.linalg.norm(self.corners[which, 1] - self.corners[which, 0], axis=1)
        least = np.where(self.smooth.sagitta[which] > 0, ASIDE, 1 - STRAIGHT)
        aside = (np.abs(straight) < least * far) & (far > NOTHING * size)
        side = np.where(np.einsum("nc,nc->n", off, self.normal[which]) < 0, -1.0, 1.0)
        return (np.where(aside, side * far, distance),
                np.where(aside[:, None], (side / np.where(far > 0, far, 1.0))[:, None] * off,
                         normal))

    def _nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) int, the triangle nearest to each of points (n, 3), and (n, 3) the nearest place on
        it, in barycentric coordinates.

        Of several that are as near that which looks most straight at the point, or away from it.
        """
        centre = self.corners.mean(axis=1)
        radius = np.linalg.norm(self.corners - centre[:, None], axis=2).max()
        corner = cKDTree(self.corners.reshape(-1, 3)).query(points)[0]
        found = cKDTree(centre).query_ball_point(points, corner + (1 + 1e-9) * radius)
        count = np.array([len(one) for one in found])
        which, point = np.concatenate(found).astype(int), np.repeat(np.arange(len(points)), count)
        share = nearest_on(self.corners[which], points[point])
        off = points[point] - np.einsum("nv,nvc->nc", share, self.corners[which])
        far, straight = np.linalg.norm(off,
                                       axis=1), np.abs(
                                           np.einsum("nc,nc->n", off, self.normal[which]))
        start = np.r_[0, np.cumsum(count)[:-1]]
        near = far <= np.repeat(np.minimum.reduceat(far, start),
                                count) + rounding(points[point], 0.0)
        order = np.lexsort((-straight, ~near, point))[start]
        return which[order], share[order]


def nearest_on(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 3) barycentric coordinates of the place on triangles (n, 3, 3) that is nearest to points
    (n, 3).
    """
    edge, arm = np.roll(corners, -1, axis=1) - corners, points[:, None] - corners
    along = np.clip(np.einsum("nec,nec->ne", arm, edge) / np.einsum("nec,nec->ne", edge, edge), 0.0,
                    1.0)
    distance = np.linalg.norm(arm - along[:, :, None] * edge, axis=2)
    best, rows = distance.argmin(axis=1), np.arange(len(points))
    share = np.zeros((len(points), 3))
    share[rows, best], share[rows, (best + 1) % 3] = 1 - along[rows, best], along[rows, best]
    one, two, first = edge[:, 0], -edge[:, 2], arm[:, 0]
    gram = np.stack([np.stack([np.einsum("nc,nc->n", a, b) for b in (one, two)], axis=1)
                     for a in (one, two)], axis=1)
    inner = np.linalg.solve(gram,
                            np.stack([np.einsum("nc,nc->n", first, a) for a in (one, two)],
                                     axis=1)[:, :, None])[:, :, 0]
    inner = np.c_[1 - inner.sum(axis=1), inner]
    return np.where((inner >= 0).all(axis=1)[:, None], inner, share)


def read_stl(file: str, path: KeyPath) -> TriangulatedSurface:
    """The surface in a file; raises InputError: it is no STL file, or its surface is not closed, or
    turned inside out.
    """
    try:
        mesh = meshio.read(file, file_format="stl")
        points, number = np.unique(mesh.points, axis=0, return_inverse=True)
        triangles = number.ravel()[mesh.get_cells_type("triangle")].reshape(-1, 3)
    except (OSError, ValueError, IndexError, meshio.ReadError) as error:
        raise wrong(path, f"{file}: {str(error) or 'no STL file'}",
                    "an STL file, of text or binary", "export it again") from error
    # others have no area
    triangles = triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]
    if not len(triangles) or not np.isfinite(points).all():
        raise wrong(path, f"{file}: no triangles, or corners that are no numbers",
                    "an STL file, of text or binary", "export it again")
    _check_closed(file, points, triangles, path)
    return TriangulatedSurface.of(points.astype(float), triangles)


def _check_closed(file: str, points: np.ndarray, triangles: np.ndarray, path: KeyPath) -> None:
    both, edge = edges_of(triangles, TRIANGLE_EDGES)
    count = np.bincount(edge.ravel())
    ways = np.bincount(edge.ravel(),
                       np.where(np.diff(triangles[:, TRIANGLE_EDGES], axis=2) > 0, 1.0,
                                -1.0).ravel())
    open_, turned = np.flatnonzero(count != 2), np.flatnonzero((count == 2) & (ways != 0))

    def refused(found: str, cure: str) -> InputError:
        return wrong(path, f"{file}: {found}",
                     "a closed surface of triangles that look outward, each edge of two of them",
                     cure)

    for edges, what, cure in (
            (open_, "a surface that is not closed: {} edges do not belong to two triangles",
             "close it, or export the whole body"),
            (turned, "triangles that are turned against their neighbours, at {} edges",
             "turn triangles alike before exporting")):
        if len(edges):
            raise refused(
                f"{what.format(len(edges))}, the first at "
                f"{format_point(points[both[edges[0]]].mean(axis=0))}", cure)
    if np.einsum("kc,kc->", area_vectors(points, triangles),
                 points[triangles].mean(axis=1) - points.mean(axis=0)) < 0:
        raise refused("a surface that is turned inside out",
                      "turn its triangles round before exporting")
