"""Distances of paired sides before anything is loaded: as the geometry has it, down to the rounding
of coordinates.

Sides that are in each other by less than a thousandth of the element size are pressed together by
as much, and that is told; deeper ones are refused: nobody is taken to have meant them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.errors import Problems
from orchestrator.linalg import PLACED, WRITTEN
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.governing import Laws
from orchestrator.scene.interfaces.mortar.operators import covered_around, node_gaps
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.opposite import COINCIDE
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.mesh.geometry import (
    format_point, local_size, node_normals, node_vectors, rounding, unit)
from orchestrator.scene.mesh.quadratic import LUMPED_SHARES

# Share of what both have in common that is inside, from which it is meant.
MANY = 0.1


def paired_distance(one: np.ndarray, two: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) distance of paired points (n, 3) along the normals of the triangles halfway between,
    negative inside each other.
    """
    normals = unit(node_vectors((one + two) / 2, triangles, LUMPED_SHARES[triangles.shape[1]]))
    return np.einsum("ij,ij->i", normals, two - one)


def paired_gap(parts: Parts, interface: Interface, key: tuple[int, str], filled: np.ndarray,
               problems: Problems) -> np.ndarray:
    """(n,) distance of the sides of an interface whose nodes are paired; in the middle of edges
    that of the surfaces, not the chords'.

    key : the entry of the YAML and what in it asks for the distance
    filled : (k, 3) what the surfaces of both sides stand off the middles of the facets' edges, see
        ``skins.Surface``
    """
    one, two = (parts.mesh.nodes[parts.numbering.nodes[own]]
                for own in parts.numbering.sides(interface))
    middle, gap = (one + two) / 2, paired_distance(one, two, interface.triangles)
    h = local_size(middle, interface.triangles)
    if (gap < -COINCIDE * h).any():
        _refuse(problems, interface, key, middle, np.where(gap < -COINCIDE * h, -gap, 0.0))
    if interface.triangles.shape[1] == 6:
        edges = interface.triangles[:, 3:].ravel()
        gap = gap - np.bincount(edges, filled.ravel(),
                                len(gap)) / np.maximum(np.bincount(edges, minlength=len(gap)), 1)
    return np.where(np.abs(gap) <= rounding(middle, PLACED * h), 0.0, gap)


def _refuse(problems: Problems, interface: Interface, key: tuple[int, str], points: np.ndarray,
            depth: np.ndarray, more: str = "") -> None:
    """Adds the problem of sides that are in each other at points (n, 3) by depths (n,), 0 where
    they are not.
    """
    worst = int(depth.argmax())
    problems.add(
        ("interfaces", *key),
        f"{interface.name} penetrate each other in the initial geometry, at "
        f"{np.count_nonzero(depth)} nodes by up to {depth[worst]:.3g} at "
        f"{format_point(points[worst])}",
        "sides that touch or are apart" + more,
        "move the parts, or ask for a press fit by a number: gap: -0.01")


def surface_gap(parts: Parts, interface: Interface, key: tuple[int, str],
                problems: Problems) -> np.ndarray:
    """(n₁,) distance of sides whose nodes do not match, at the slave's, as its multipliers see it;
    negative inside each other.

    From surface to surface, not from facet to facet: chords of different polygons about the same
    circle are in each other here and apart there; the surfaces are not.

    Sides that facets leave open or overlap by less than what is known of the surfaces
    (``Surface.unsure``) touch, and where facets are in each other by less than their sagitta this
    counts as touching too; both are told.

    key : the entry of the YAML and what in it asks for the distance
    """
    surfaces = interface.surfaces
    x1, h, inside = surfaces.points[0], surfaces.size, -_mean_distance(surfaces)
    off_facets, unsure = (around(surfaces, *(getattr(side, name) for side in surfaces.under))
                          for name in ("sagitta", "unsure"))
    deep = inside > off_facets + COINCIDE * h
    if deep.any():
        off = (
            "; facets there are off the surfaces that they stand for by "
            f"{off_facets[np.where(deep, inside, 0.0).argmax()]:.3g} at most")
        _refuse(problems, interface, key, x1, np.where(deep, inside, 0.0), off)
    gap, nothing = _surface_distance(parts, surfaces), rounding(x1, PLACED * h)
    if not deep.any():
        _refuse_press_fit(parts, interface, key, gap, unsure + nothing, problems)
    touching = (gap <= unsure + nothing) & (gap >= -off_facets - nothing)
    if (touching
        & ((unsure > COINCIDE * h)
           | (gap < -np.maximum(unsure, COINCIDE * h)))).any() and not deep.any():
        problems.warnings.append(
            f"{interface.name}: the mesh's flat faces lie up to {off_facets.max():.2g} off the "
            f"round surfaces, so that a clearance below {unsure.max():.2g} and an overlap below "
            f"{off_facets.max():.2g} may be the mesh's alone: such sides count as touching. Where "
            "it matters, give the clearance or the press fit as a number, gap: 0.01, or mesh finer")
    return np.where(touching, 0.0, gap)


def _surface_distance(parts: Parts, surfaces: Surfaces) -> np.ndarray:
    """Return (n₁,) the distance of the surfaces that facets stand for, at the slave's nodes."""
    weights, corners = surfaces.weights, surfaces.triangles[0]
    held = surfaces.held(weights, tuple(parts.held[nodes] for nodes in surfaces.nodes))
    gap = node_gaps(surfaces, weights, surfaces.upright(held)) - surfaces.filled
    if surfaces.amid:  # a corner has what is beside it
        at, beside = np.repeat(corners[:, :3].ravel(), 2), corners[:, [3, 5, 3, 4, 4, 5]].ravel()
        count = np.bincount(at, minlength=len(gap))
        mean = np.bincount(at, gap[beside], len(gap)) / np.maximum(count, 1)
        gap = np.where(count > 0, mean, gap)
    return gap


def _refuse_press_fit(parts: Parts, interface: Interface, key: tuple[int, str], gap: np.ndarray,
                      unsure: np.ndarray, problems: Problems) -> None:
    """Add a problem where sides that are both curved, by surfaces that are known, are in each
    other by more than their meshes leave ``unsure`` (n₁,): nobody says whether that is a press
    fit, and chords know its depth only nearly."""
    surfaces = interface.surfaces
    flat = (((side.sagitta == 0) | np.isnan(side.normals).any(axis=(1, 2))).astype(float)
            for side in surfaces.under)
    inside, area = (gap < -unsure) & (around(surfaces, *flat) == 0), covered_around(surfaces)
    if area[inside].sum() <= MANY * area.sum():
        return
    order = np.flatnonzero(inside)[np.argsort(gap[inside])]
    depth = float(-gap[order[np.searchsorted(np.cumsum(area[order]), area[order].sum() / 2)]])
    one = _radii(parts, surfaces, 0, surfaces.segments.slave)
    two = _radii(parts, surfaces, 1, surfaces.segments.master)
    known = np.abs(one - two)[~np.isnan(one - two)]
    depth = depth if not len(known) else float(np.median(known))  # as the CAD model has it
    at = surfaces.points[0][order[0]]
    problems.add(
        ("interfaces", *key), f"{interface.name} are drawn inside each other by about {depth:.4g}, "
                              f"at {format_point(at)}, and nothing says whether that is a press "
                              "fit",
        "round sides that touch or are apart, or a gap",
        f"for the press fit write gap: {-depth:.4g}; to take the sides as touching, gap: 0")


def _radii(parts: Parts, surfaces: Surfaces, side: int, facets: np.ndarray) -> np.ndarray:
    """Return (m,) the radius of the CAD face that each of a side's facets (m,) is on; else nan."""
    radii = [np.nan if shape.radius is None else shape.radius
             for shape in parts.mesh.smooth.values()]
    at = parts.faces.find(surfaces.nodes[side][surfaces.triangles[side][facets, :3]])
    return np.array([*radii, np.nan])[parts.skins.smooth[at]]


def _curved(surfaces: Surfaces) -> bool:
    """Whether the slave's facets are not in one plane."""
    normal = unit(surfaces.vectors)
    normal = normal[normal.any(axis=1)]
    return bool(np.abs(normal - normal[:1]).max(initial=0.0) > PLACED)


def around(surfaces: Surfaces, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(n₁,) the largest sagitta, of the sides' (k₁,) and (k₂,) together, around each of the slave's
    nodes.
    """
    result, reached = (np.zeros(len(surfaces.points[0])) for _ in range(2))
    segments = surfaces.segments
    for corner in surfaces.triangles[0].T:
        np.maximum.at(result, corner, one)
        np.maximum.at(reached, corner[segments.slave], two[segments.master])
    return result + reached


def _mean_distance(surfaces: Surfaces) -> np.ndarray:
    """(n₁,) distance of the facets, averaged over what is covered around each of the slave's
    nodes.
    """
    segments, count = surfaces.segments, len(surfaces.points[0])
    around = surfaces.triangles[0][segments.slave]
    area, moment = (np.bincount(around.ravel(), np.repeat(w, around.shape[1]), count)
                    for w in (segments.area, segments.area * segments.distance))
    return moment / np.where(area > 0, area, 1.0)


def tell_distances(parts: Parts, laws: Laws, found: Sequence[Interface],
                   problems: Problems) -> None:
    """Warns, once per pair of bodies, where the geometry presses sides together, and where it has
    sides apart, or in each other,
    that count as touching because nothing is said of their gap."""
    worst: dict[tuple[bool, tuple[str, ...]], tuple[float, np.ndarray, tuple[int, int]]] = {}
    for interface in found:
        read = bool(laws[interface.entry].apart)
        if not read and getattr(laws[interface.entry], "gap", 0.0) is not None:
            continue  # its law does not open, or a word is said on its gap
        if not read and interface.surfaces is not None and _curved(interface.surfaces):
            surfaces = interface.surfaces
            sure = around(surfaces, *(side.unsure for side in surfaces.under)) + rounding(
                surfaces.points[0], PLACED * surfaces.size)
            _refuse_press_fit(parts, interface, (interface.entry, "between"),
                              _surface_distance(parts, surfaces), sure, problems)
        points = parts.mesh.nodes[interface.global_nodes]
        gap = np.minimum(interface.law.distance, 0.0) if read else _apart(parts, interface, points)
        h = local_size(points, interface.triangles)
        size = np.where(np.abs(gap) > np.maximum(WRITTEN * h, rounding(points, PLACED * h)),
                        np.abs(gap), 0.0)
        at, key = int(size.argmax()), (read,
                                       tuple(sorted(parts.partition.body(e)
                                                    for e in interface.subdomains)))
        if size[at] > abs(worst[key][0] if key in worst else 0.0):
            worst[key] = float(gap[at]), points[at], interface.subdomains
    for (read, names), (gap, point, sides) in worst.items():
        where = (
            f"{abs(gap):.2g} {'apart' if gap > 0 else 'inside each other'} in the initial "
            f"geometry, at {format_point(point)}, and ")
        problems.warnings.append(f"{' | '.join(names)}: sides are up to {where}" + (
            "are pressed together by as much; gap: 0 takes them as touching" if read else
            "count as touching; gap: geometry reads the distance, gap: 0 says that they touch"))


def _apart(parts: Parts, interface: Interface, points: np.ndarray) -> np.ndarray:
    """(n,) distance along the normal of sides that count as touching; zero on curved faces that do
    not match: facets are
    apart there where their surfaces touch."""
    if interface.surfaces is None:
        return paired_distance(points,
                               parts.mesh.nodes[
                                   parts.numbering.nodes[parts.numbering.sides(interface)[1]]],
                               interface.triangles)
    normal = node_normals(points, interface.triangles)
    if np.abs(normal - normal[0]).max() > PLACED:
        return np.zeros(len(points))
    return node_gaps(interface.surfaces, interface.surfaces.weights, normal)
