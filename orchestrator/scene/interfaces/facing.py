"""Faces of two bodies that lie on each other, whatever their meshes, found by what they have in
common:
second step of the search for pairs.

Facets face each other where they look at each other, overlap along the normal, and the surfaces
that they stand for are no farther apart than a share of the element size there. The surfaces, not
the facets: chords of two polygons about the same circle are apart, or in each other, by as much as
either is off the circle (``skins``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from orchestrator.config.boundary import ROUND
from orchestrator.errors import Problems
from orchestrator.kept import kept
from orchestrator.scene.interfaces.overlap import Hidden
from orchestrator.scene.interfaces.governing import Candidate
from orchestrator.scene.interfaces.matching import back_to_back, match, Patch
from orchestrator.scene.interfaces.mortar.moving import whole_faces
from orchestrator.scene.interfaces.mortar.segments import FACING, Segments, find_segments
from orchestrator.scene.interfaces.mortar.surfaces import slave_of, Surfaces, surfaces_of, turned
from orchestrator.scene.interfaces.opposite import BodyFaces, COINCIDE, OPPOSITE, TOUCHING
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.interfaces.skins import over, Skin, smooth_patches
from orchestrator.scene.mesh.faces import components, edge_patches
from orchestrator.scene.mesh.mesh import Mesh

# What two bodies have in common is a pair from this share of the smaller facet there, and if this
# share of it is sure:
# less is where edges cross.
COMMON = 0.1 / ROUND


@dataclass(frozen=True)
class Facing:
    """A connected patch of faces of two bodies that lie on each other.

    segments : the overlaps, the first body being the slave, in the numbers of the bodies' facets
    distance : (m,) of the surfaces along the normal in the middle of each, negative inside each
        other
    size : mean element size of either side
    """

    segments: Segments
    distance: np.ndarray
    size: tuple[float, float]

    @property
    def area(self) -> float:
        """Area that both have in common."""
        return float(self.segments.area.sum())

    @property
    def facets(self) -> tuple[np.ndarray, np.ndarray]:
        """(k₁,), (k₂,) int, ascending, which facets of either body."""
        return np.unique(self.segments.slave), np.unique(self.segments.master)


def facing(one: Skin, two: Skin, tolerance: float = TOUCHING, within: float | None = None,
           cosine: float = OPPOSITE, wide: bool = False, creases: bool = False,
           hidden: Hidden | None = None) -> list[Facing]:
    """The patches on which two bodies lie on each other, the one with the first facet first.

    tolerance : how far apart surfaces may be, a share of the smaller element size there, or of the
        larger where ``wide``
    within : the same as a length, instead
    cosine : that between facets' normals is below this
    hidden : whether another body is between two facets; none: nothing is
    creases : patches end at creases that both bodies have: a shank with its head in a hole are two
        patches
    """
    x, y = one.body, two.body
    size = np.maximum(x.size, y.size.max(initial=0.0)) if wide else x.size
    reach = (tolerance * size if within is None
             else within) + one.surface.sagitta + two.surface.sagitta.max(initial=0.0)
    found = find_segments(x, y, reach, cosine)
    found = found.some(~back_to_back(x, y, found.slave, found.master,
                                     np.where(found.distance < -COINCIDE * x.size[found.slave],
                                              -found.distance,
                                              0.0)))
    if hidden is not None:
        mine, theirs = found.middles
        found = found.some(~hidden(found.slave, mine, found.master, theirs, found.distance))
    i, j = found.slave, found.master
    here, there = one.surface.some(i), two.surface.some(j)
    distance = found.distance - sum(over(side.bulge, at)
                                    for side, at in zip((here, there), found.middles))
    allowed = tolerance * (np.maximum if wide else np.minimum)(
        x.size[i], y.size[j]) if within is None else within
    beyond = np.abs(distance) - allowed
    sure = beyond <= here.unsure + there.unsure
    if not sure.any():
        return []
    kept = np.flatnonzero(beyond <= here.sagitta + there.sagitta)
    # what is not sure is judged by the smooth face it is on, on either side: beyond a crease begins
    # another one
    for skin, own in ((one, i), (two, j)):
        facets, at = np.unique(own[kept], return_inverse=True)
        patch = smooth_patches(skin.body.triangles[facets, :3], skin.body.normal[facets],
                               skin.face[facets])[at]
        common, certain = (np.bincount(patch, found.area[kept] * share)
                           for share in (1.0, sure[kept]))
        kept = kept[(certain > COMMON * common)[patch]]
    facets, at = np.unique(i[kept], return_inverse=True)
    patch = edge_patches(x.triangles[facets, :3])[1][at]
    if creases:
        sides = [smooth_patches(skin.body.triangles[f, :3], skin.body.normal[f], skin.face[f])[k]
                 for skin, own in ((one, i), (two, j))
                 for f, k in [np.unique(own[kept], return_inverse=True)]]
        count = sides[0].max(initial=-1) + 1
        whole = components(sides[0], count + sides[1],
                           count + int(sides[1].max(initial=-1)) + 1)[1][sides[0]]
        patch = np.unique(np.column_stack([patch, whole]), axis=0, return_inverse=True)[1].ravel()
    patches = [kept[patch == label] for label in range(int(patch.max(initial=-1)) + 1)]
    return [Facing(found.some(p), distance[p], (float(mine.mean()), float(theirs.mean())))
            for p in patches
            for mine, theirs in [(x.size[np.unique(i[p])], y.size[np.unique(j[p])])]
            if found.area[p].sum() >= COMMON * min(mine.min(), theirs.min()) ** 2 / 2]


def matching_faces(parts: Parts, candidate: Candidate) -> list[Patch]:
    """Return the patches on which the nodes of a candidate's faces match."""
    entry = candidate.entry
    return _matching(parts, candidate.pair, bool(entry.apart), entry.reach, candidate.tolerance)


@kept
def _matching(parts: Parts, pair: tuple[BodyFaces, BodyFaces], apart: bool, within: float | None,
              tolerance: float) -> list[Patch]:
    return match(*pair, apart, within, tolerance, parts.hidden(*pair))


def meshed_apart(parts: Parts, candidate: Candidate, patches: list[Patch], slaves: dict[tuple, str],
                 problems: Problems) -> list[tuple[int, Surfaces]]:
    """Return the slave, 0 or 1, and the surfaces of each patch on which faces of a candidate lie
    on each other and do not match; none where all that lie opposite each other do.

    Where some match and others do not, all count as not matching: a corner that happens to fit is
    no reason for another interface. So they do where they are paired anew as they slide.

    patches : of faces that match
    slaves : of pairs of bodies that are cut further, the names of those whose pieces are the
        slaves, once chosen
    """
    mesh, pair, entry, names = parts.mesh, candidate.pair, candidate.entry, candidate.known
    matched = np.concatenate([np.empty(0, int), *(patch.facets[:, 0] for patch in patches)])
    found = _facing(parts, candidate)
    if not found or not entry.follows and all(
            np.isin(f.segments.slave, matched).all() for f in found):
        return []
    slave = candidate.slave
    if slave is None and (quadratic := _quadratic(mesh, pair)) is not None:
        slave = quadratic if candidate.entry.kind.as_one else 1 - quadratic
    if slave is None and any(map(parts.cut_further, pair)):
        slave = _for_all_pieces(parts, candidate, slaves)
    if entry.follows and (why := _rests(parts, pair)):
        problems.add(("interfaces", candidate.index, "pairing"),
                     f"follow between {names[0][0]} and {names[1][0]}, {why[0]}", *why[1:])
        return []
    result = []
    for patch in found:
        more = tuple(whole_faces(parts.skins(b), own)
                     for b, own in zip(pair, patch.facets)) if entry.follows else None
        segments = patch.segments.nearest(pair[0].area)
        surfaces = surfaces_of(mesh.nodes, pair, segments, more)
        own = _slave(parts, candidate, [surfaces]) if slave is None else slave
        if own:
            surfaces = turned(mesh.nodes, pair, segments, max(FACING, candidate.cosine), more)
        result.append((own, surfaces))
        if mesh.foreign and _same_nodes(surfaces):
            problems.warnings.append(
                f"all {len(surfaces.nodes[0])} nodes of {names[0][0]} | {names[1][0]} coincide, "
                "and faces between them are cut otherwise: forces are carried from face to face, "
                "not from node to node; give both sides the same faces")
    return result


def _facing(parts: Parts, candidate: Candidate) -> list[Facing]:
    """Surfaces of two bodies that lie on each other as an entry has it."""
    entry = candidate.entry
    return _on_each_other(parts, candidate.pair, candidate.tolerance, entry.reach,
                          candidate.cosine, bool(entry.apart), not entry.kind.as_one)


@kept
def _on_each_other(parts: Parts, pair: tuple[BodyFaces, BodyFaces], tolerance: float,
                   within: float | None, cosine: float, wide: bool,
                   creases: bool) -> list[Facing]:
    return facing(*map(parts.skins, pair), tolerance, within, cosine, wide, creases,
                  parts.hidden(*pair))


def _rests(parts: Parts, pair: tuple[BodyFaces, BodyFaces]) -> tuple[str, str, str] | None:
    """Why two bodies cannot slide on each other, what could, and the cure."""
    if any(map(parts.cut_further, pair)):
        return ("pieces of bodies that are cut further",
                "bodies in one piece each: a node has one piece to slide on",
                "leave split_above out, or write pairing: fixed")
    if any(stand.volume == b.volume for stand in parts.mesh.foreign for b in pair):
        return ("of which one has a mesh that is not ours",
                "parts with meshes of ours: where nodes of another's have gone was not tried",
                "write pairing: fixed")
    return None


def _same_nodes(surfaces: Surfaces) -> bool:
    """Whether each node of either side coincides with one of the other's."""
    from scipy.spatial import cKDTree  # parts of other programs alone are asked

    one, two = surfaces.points
    near = COINCIDE * surfaces.size
    return len(one) == len(two) and bool((cKDTree(two).query(one)[0] <= near).all())


def _quadratic(mesh: Mesh, pair: tuple[BodyFaces, BodyFaces]) -> int | None:
    """The one of two bodies that is a part of quadratic elements whose mesh is not ours; None:
    neither, or both.

    Bonded it is the slave: its nodes' forces are then any, and its functions between nodes, which
    are not the triangles', are not asked for. Under a law that opens it is the master: uniform
    pressure is tension at the corners of its faces.
    """
    known = [any(stand.quadratic and stand.volume == b.volume for stand in mesh.foreign)
             for b in pair]
    return known.index(True) if sum(known) == 1 else None


def _slave(parts: Parts, candidate: Candidate, patches: list[Surfaces]) -> int:
    return slave_of(patches, parts.young, parts.held, candidate.entry.kind.as_one)


def _for_all_pieces(parts: Parts, candidate: Candidate, slaves: dict[tuple, str]) -> int:
    """The slave, by all pieces of two bodies of which one is cut further."""
    body = parts.partition.body
    named = tuple(body(b.subdomain) for b in candidate.pair)
    ordered = tuple(sorted(named))
    if ordered not in slaves:
        pieces = [[b for b in parts.bodies if body(b.subdomain) == name] for name in ordered]
        patches = [surfaces_of(parts.mesh.nodes, two, f.segments) for two in product(*pieces)
                   for f in _facing(parts, replace(candidate, pair=two))]
        slaves[ordered] = ordered[_slave(parts, candidate, patches)]
    return named.index(slaves[ordered])
