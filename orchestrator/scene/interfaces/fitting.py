"""Third step of the search for pairs: interfaces of faces that lie on each other, with the law of
their entry and, where it asks for that, the distance that the geometry has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.interface import Interface
from orchestrator.scene.interfaces.distances import paired_gap, surface_gap
from orchestrator.scene.interfaces.governing import Candidate, Laws
from orchestrator.scene.interfaces.matching import Patch
from orchestrator.scene.interfaces.mortar.surfaces import Surfaces
from orchestrator.scene.interfaces.opposite import BodyFaces
from orchestrator.scene.interfaces.parts import Parts
from orchestrator.scene.interfaces.skins import surface_of


def of_matching(parts: Parts, laws: Laws, candidate: Candidate, patches: Sequence[Patch],
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


def of_surfaces(parts: Parts, laws: Laws, candidate: Candidate,
                found: Sequence[tuple[int, Surfaces]], problems: Problems) -> Iterator[Interface]:
    """Yield the interfaces of surfaces that are meshed each on its own, with the slave, 0 or 1."""
    for slave, surfaces in found:
        turn = slice(None, None, -1 if slave else 1)
        skins = [parts.skins(body) for body in candidate.pair[turn]]
        under = [skin.under(nodes[t])
                 for skin, nodes, t in zip(skins, surfaces.nodes, surfaces.triangles)]
        # of a face that is part of more, the part alone may be on a surface that is known
        triangles = surfaces.triangles[0]
        alone = surface_of(surfaces.points[0], triangles, np.full(len(triangles), -1),
                           under[0].normals)
        surfaces = replace(surfaces, under=(replace(under[0], normals=alone.normals), under[1]),
                           amid=triangles.shape[1] == 6 and not candidate.entry.kind.as_one)
        interface = parts.interface(
            tuple(skin.body.subdomain for skin in skins), surfaces.nodes, triangles,
            surfaces.behind[0], surfaces=surfaces, called=tuple(candidate.known[turn]))
        key = candidate.index, candidate.entry.apart
        laws.apply(candidate.index, interface,
                   surface_gap(parts, interface, key, problems) if key[1] else None)
        yield interface
