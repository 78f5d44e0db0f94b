"""How far apart sides are whose nodes do not match, before anything is loaded: from surface to surface, not from facet to
facet. Chords of different polygons about the same circle are in each other here and apart there; the surfaces are not."""

from __future__ import annotations

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interfaces.curvature import sagittas
from orchestrator.scene.interfaces.distances import rounding
from orchestrator.scene.interfaces.facing import UNSURE
from orchestrator.scene.interfaces.mortar.assembly import node_gaps, point_normals, weights_of
from orchestrator.scene.interfaces.mortar.duals import multipliers
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.pairing import COINCIDE
from orchestrator.scene.mesh.patch import local_size
from orchestrator.scene.mesh.quality import format_point


def initial_gap(name: str, surfaces: Surfaces, bulge: tuple[np.ndarray, np.ndarray], key: tuple[int, str],
                problems: Problems) -> np.ndarray:
    """(n₁,) distance of the sides at the slave's nodes, as its multipliers see it; negative inside each other.

    Sides that facets leave open or overlap by less than what is known of the surfaces (``UNSURE`` of the sagitta) touch, and
    where facets are in each other by less than their sagitta this counts as touching too; both are told.

    Parameters
    ----------
    name : of the interface
    bulge : (k₁, 3), (k₂, 3) of the facets' edges, see ``curvature.bulges``
    key : the entry of the YAML and what in it asks for the distance
    """
    x1, one, segments = surfaces.points[0], surfaces.triangles[0][:, :3], surfaces.segments
    sagitta = tuple(sagittas(b) for b in bulge)
    h, around, inside = local_size(x1, one), _around(surfaces, *sagitta), -_mean_distance(surfaces)
    deep = inside > around + COINCIDE * h
    if deep.any():
        worst = int(np.where(deep, inside, 0.0).argmax())
        problems.add(("interfaces", *key), f"{name} penetrate each other in the initial geometry, at {deep.sum()} nodes by up "
                     f"to {inside[worst]:.3g} at {format_point(x1[worst])}", "sides that touch or are apart; facets there are "
                     f"off the surfaces that they stand for by {around[worst]:.3g} at most",
                     "move the parts, or ask for a press fit by a number: gap: -0.01")
    facets = node_gaps(surfaces, weights_of(surfaces, quadratic=False), point_normals(x1, one))
    gap = facets - _between(surfaces, bulge)
    nothing = rounding(x1, h)
    touching = (gap <= UNSURE * around + nothing) & (gap >= -around - nothing)
    if (touching & (around > COINCIDE * h)).any() and not deep.any():
        problems.warnings.append(
            f"{name}: facets are up to {max(0.0, -segments.distance.min()):.2g} inside each other and up to "
            f"{max(0.0, segments.distance.max()):.2g} apart, off the curved surfaces that they stand for by up to {around.max():.2g}: "
            f"what is within {UNSURE:g} of that counts as touching; smaller clearances and press fits need a number, gap: 0.01, "
            "or finer meshes")
    return np.where(touching, 0.0, gap)


def _between(surfaces: Surfaces, bulge: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(n₁,) what the surfaces of both sides fill of the gap between facets, averaged with the multipliers of the nodes."""
    # the bulges are quadratic functions: of nodes of its own amid each facet's edges
    nodes, ends, values = [], [], []
    for points, triangles, own in zip(surfaces.points, surfaces.triangles, bulge):
        middles = len(points) + np.arange(own.size).reshape(own.shape)
        nodes.append(np.hstack([triangles[:, :3], middles]))
        ends.append(len(points) + own.size)
        values.append(np.concatenate([np.zeros(len(points)), own.ravel()]))
    weights = multipliers(surfaces.segments, *nodes, surfaces.area, tuple(ends))
    filled = weights.own @ values[0] + weights.other @ values[1]
    count = len(surfaces.points[0])
    return (filled / np.where(weights.area > 0, weights.area, 1.0))[:count]


def _around(surfaces: Surfaces, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(n₁,) the largest sagitta, of the sides' (k₁,) and (k₂,) together, around each of the slave's nodes."""
    result, reached = (np.zeros(len(surfaces.points[0])) for _ in range(2))
    segments = surfaces.segments
    for corner in surfaces.triangles[0][:, :3].T:
        np.maximum.at(result, corner, one)
        np.maximum.at(reached, corner[segments.slave], two[segments.master])
    return result + reached


def _mean_distance(surfaces: Surfaces) -> np.ndarray:
    """(n₁,) distance of the facets, averaged over what is covered around each of the slave's nodes."""
    segments, count = surfaces.segments, len(surfaces.points[0])
    corners = surfaces.triangles[0][segments.slave, :3].ravel()
    area, moment = (np.bincount(corners, np.repeat(w, 3), count) for w in (segments.area, segments.area * segments.distance))
    return moment / np.where(area > 0, area, 1.0)
