"""The search for pairs in its four steps: which bodies may have one (``governing``), where their
faces lie on each other (``facing``), the interfaces there, with the law of their entry and, where
it asks for that, the distance that the geometry has; and, once it is known what supports hold,
their operators (``freedom``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from orchestrator.errors import LISTED, Problems, some
from orchestrator.scene.interface import Beside, ends_of, Interface
from orchestrator.scene.interfaces.distances import paired_gap, surface_gap, tell_distances
from orchestrator.scene.interfaces.facing import matching_faces, meshed_apart
from orchestrator.scene.interfaces.governing import Candidate, candidates, Laws
from orchestrator.scene.interfaces.matching import Patch
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.neighbours import report_loose_pieces, report_neighbours
from orchestrator.scene.interfaces.opposite import BodyFaces, COINCIDE, nearest, REACH
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.interfaces.shared import hinges, shared_faces
from orchestrator.scene.interfaces.skins import surface_of
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import facet_normals, format_point
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.names import suggestion

# Share of a part's thickness from which an interference is outside small strains.
DEEP = 0.1


def make_interfaces(parts: Parts, laws: Laws,
                    problems: Problems) -> tuple[list[Interface], dict[tuple[int, int], Beside]]:
    """Return all interfaces, ordered by pair of subdomains, then by their lowest face; then those
    of opposite faces, then ``hinges``.

    Pairs that touch along an edge or in a node are one only where nothing else joins them there.
    All components count as free, see ``leave_free``.

    Returns interfaces, and the pairs of volumes that are near each other without one, as
    ``report_neighbours``
    """
    found, near = shared_faces(parts, laws, problems), {}
    count, piece = components(*ends_of(found).T, len(parts.partition.names))
    if count > 1:  # pieces of one volume that no faces connect
        report_loose_pieces(parts, piece[parts.partition.subdomain], problems)
    found += _opposite(parts, laws, problems)
    body = parts.partition.body
    within = [body(one) == body(two) for one, two in (i.subdomains for i in found)]
    cuts, pairs = ([parts.names(i.subdomains) for i, cut in zip(found, within) if cut == wanted]
                   for wanted in (True, False))
    found += hinges(parts, laws, found)
    for number, interface in enumerate(found):
        interface.index = number
    laws.refuse_within(cuts, problems)
    _report_deep(parts.mesh, found, problems)
    if laws.asked:
        _report_unused(parts, laws, list(dict.fromkeys(pairs)), problems)
    if parts.bodies and not problems.found:
        tell_distances(parts, laws, found, problems)
        near = report_neighbours(parts, laws, found, problems)
    return found, near


def _report_deep(mesh: Mesh, found: list[Interface], problems: Problems) -> None:
    """Adds a problem for each press fit deeper than ``DEEP`` of what the thinner part measures
    along the normals: such numbers are in another unit.
    """
    for i in found:
        if deep := -np.min(i.law.distance, initial=0.0):
            normals = abs(facet_normals(mesh.nodes[i.global_nodes], i.triangles)[0])
            thick = min((normals @ np.ptp(mesh.nodes[mesh.cells[mesh.volume == v]],
                                          axis=(0, 1))).min()
                        for v in mesh.volume[i.cells[0]])
            if deep > DEEP * thick:
                problems.add(
                    ("interfaces", i.entry, "gap"),
                    f"an interference of {deep:g} between {i.name}, which is {deep / thick:.0%} of "
                    f"what the thinner part measures there, {thick:.4g}",
                    f"at most {DEEP:.0%}, as strains are small; press fits have about a thousandth",
                    "write gap in the unit of the mesh; it is half the difference of two diameters")


def _opposite(parts: Parts, laws: Laws, problems: Problems) -> list[Interface]:
    """Interfaces of parts that share no faces there."""
    result, slaves = [], {}
    for one in candidates(parts, laws):
        patches, surfaces = matching_faces(parts, one), []
        if laws.asked and one.index >= 0:
            surfaces = meshed_apart(parts, one, patches, slaves, problems)
        if patches or surfaces:
            laws.between(*one.known)
        result += _of_surfaces(parts, laws, one, surfaces, problems) if surfaces else _of_matching(
            parts, laws, one, patches, problems)
    return result


def _of_matching(parts: Parts, laws: Laws, candidate: Candidate, patches: Sequence[Patch],
                problems: Problems) -> Iterator[Interface]:
    """Yield the interfaces of patches whose nodes match, node against node."""
    pair = candidate.pair
    for patch in patches:
        nodes, at, local = np.unique(patch.triangles, return_index=True, return_inverse=True)
        interface = parts.interface(
            tuple(b.subdomain for b in pair), (nodes, patch.opposite.ravel()[at]),
            local.reshape(patch.triangles.shape), patch.cells, called=candidate.known)
        if parts.skins.given(pair[0]) is not None:
            interface.given = parts.skins(pair[0]).surface.normals[patch.facets[:, 0]]
        key = candidate.index, candidate.entry.apart
        laws.apply(candidate.index, interface, None if not key[1] else paired_gap(
            parts, interface, key, _filled(parts, pair, patch), problems))
        yield interface


def _filled(parts: Parts, pair: tuple[BodyFaces, BodyFaces], patch: Patch) -> np.ndarray:
    """(k, 3) what the surfaces of both sides fill of the gap amid the edges of a patch's facets; of
    three-node ones nothing."""
    if patch.triangles.shape[1] == 3:
        return np.zeros((len(patch.triangles), 3))
    one, two = (parts.skins(body).surface.bulge[facets]
                for body, facets in zip(pair, patch.facets.T))
    behind = pair[1].triangles[patch.facets[:, 1], 3:]
    order = (patch.opposite[:, 3:, None] == behind[:, None, :]).argmax(axis=2)
    return one + np.take_along_axis(two, order, axis=1)


def _of_surfaces(parts: Parts, laws: Laws, candidate: Candidate,
                found: Sequence[tuple[int, Surfaces]], problems: Problems) -> Iterator[Interface]:
    """Yield the interfaces of surfaces that are meshed each on its own, with the slave, 0 or 1."""
    for slave, surfaces in found:
        turn = slice(None, None, -1 if slave else 1)
        skins = [parts.skins(body) for body in candidate.pair[turn]]
        under = [skin.under(nodes[t])
                 for skin, nodes, t in zip(skins, surfaces.nodes, surfaces.triangles)]
        # of a face that is part of more, the part alone may be on a surface that is known
        triangles = surfaces.triangles[0]
        alone = surface_of(surfaces.points[0], triangles, -1, under[0].normals)
        surfaces = replace(surfaces, under=(replace(under[0], normals=alone.normals), under[1]),
                           amid=triangles.shape[1] == 6 and not candidate.entry.kind.as_one)
        interface = parts.interface(
            tuple(skin.body.subdomain for skin in skins), surfaces.nodes, triangles,
            surfaces.behind[0], surfaces=surfaces, called=tuple(candidate.known[turn]))
        key = candidate.index, candidate.entry.apart
        laws.apply(candidate.index, interface,
                   surface_gap(parts, interface, key, problems) if key[1] else None)
        yield interface


def _report_unused(parts: Parts, laws: Laws, pairs: list[tuple[str, str]],
                   problems: Problems) -> None:
    """Adds a problem for each entry that matched no interface; one for all parts may, where there
    are no two.

    pairs : names of the two sides of existing interfaces, for the cure
    """
    for i, (entry, used) in enumerate(zip(laws.entries, laws.used)):
        for key, pattern in [*((("exclude", k), p) for k, two in enumerate(entry.exclude or [])
                               for p in two), (("slave",), entry.slave)]:
            if pattern is not None and not laws.meant(pattern):
                problems.add(("interfaces", i, *key),
                             f"{pattern!r} matches no subdomain and no volume",
                             "names of parts, shell wildcards allowed",
                             suggestion(pattern, laws.names, "part"))
        everything = entry.pair == ("*", "*")
        if used or entry.found or entry.tool is not None or (everything and parts.pieces[0] < 2):
            continue  # of pairs that are found, ``report_neighbours`` says which are missing
        where = entry.apart or "between"
        if unknown := [p for p in entry.pair if not laws.meant(p)]:
            where = "between"
            found = f"{' and '.join(repr(p) for p in unknown)} matches no subdomain and no volume"
            cure = "; ".join(suggestion(p, laws.names, "part") for p in unknown)
        elif everything:
            found = (
                f"no interface in all the scene: its {parts.pieces[0]} separate pieces share no "
                "face" + _how_far(parts, laws, entry))
            cure = (
                "mesh what touches alike on both sides; for gaps, let the law read them (contact: "
                "gap: geometry); for parts that have nothing to do with each other leave "
                "interfaces out")
        else:
            found = (
                f"no interface between {entry.pair[0]!r} and {entry.pair[1]!r}: they share no face"
                + _how_far(parts, laws, entry))
            beside = [pair for pair in pairs
                      if any(laws.means(p, pair) for p in entry.pair if p != "*")] or pairs
            cure = (
                "interfaces exist between " + some([" | ".join(b) for b in beside], 6)
                if pairs
                else "write between: auto, which reaches over small gaps, or gap: geometry"
            )
        problems.add(("interfaces", i, where), found,
                     "names of two parts that share faces, or whose faces lie on each other; "
                     "shell wildcards allowed", cure)


def _how_far(parts: Parts, laws: Laws, entry: Any) -> str:
    """Distance of the nearest nodes of the parts that an entry names."""
    sides = [[b for b in parts.bodies if laws.means(pattern, parts.known(b))]
             for pattern in entry.pair]
    pairs = [(a, b) for a, b in product(*sides) if a.volume != b.volume]
    if not pairs or len(pairs) > LISTED:
        return ""
    for a, b in pairs:
        if (inside := parts.inside(a.volume, b.volume)) is not None:
            return (
                f"; {parts.mesh.volumes[a.volume]} and {parts.mesh.volumes[b.volume]} are inside"
                f" each other by about {inside.depth:.3g}, at {format_point(inside.where)}"
            )
    distance, where, size = min((nearest(a, b) for a, b in pairs), key=lambda f: f[0])
    allowed = (f"faces are sought within {entry.reach or REACH * size:.3g} along the normal"
               if entry.apart else f"nodes coincide within {COINCIDE * size:.3g}")
    return (
        f"; their nearest nodes are {distance:.3g} apart, at {format_point(where)}, and {allowed}")
