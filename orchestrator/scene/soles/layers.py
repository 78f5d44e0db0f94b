"""Layers on the facets of many interfaces at once; those that ``prisms`` would have to mend are left to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors
from orchestrator.scene.mesh.patch import node_normals
from orchestrator.scene.partition.numbering import rounded
from orchestrator.scene.soles.facets import Facets
from orchestrator.scene.soles.prisms import prisms, sound, split, three_tets
from orchestrator.scene.soles.sole import Sole

TOGETHER = 50_000  # facets: more than enough for long arrays, some ten MB of them


def layers(facets: Sequence[Facets]) -> list[tuple[Sole, Sole]]:
    """What ``prisms`` makes of each, outward of the first side and of the second."""
    result: list[tuple[Sole, Sole]] = []
    first = 0
    ends = np.cumsum([len(f.triangles) for f in facets])
    while first < len(facets):
        last = max(first + 1, int(np.searchsorted(ends, (ends[first - 1] if first else 0) + TOGETHER, side="right")))
        result += _together(facets[first:last])
        first = last
    return result


def _together(facets: Sequence[Facets]) -> list[tuple[Sole, Sole]]:
    if len(facets) == 1 or any(f.triangles.shape[1] != 3 for f in facets):
        return [(prisms(f, +1), prisms(f, -1)) for f in facets]
    nodes, counts = (np.array([len(x) for x in lists]) for lists in ([f.points for f in facets], [f.triangles for f in facets]))
    starts, ends = np.cumsum(nodes) - nodes, np.cumsum(counts)
    points, thickness, young, poisson = (np.concatenate([getattr(f, name) for f in facets])
                                         for name in ("points", "thickness", "young", "poisson"))
    own = np.concatenate([f.triangles for f in facets])  # numbered within each
    shift = np.repeat(starts, counts)[:, None]
    corners = own + shift
    rank = np.empty(len(points), dtype=int)
    order = np.lexsort((*np.concatenate([rounded(f.points) for f in facets], axis=1), np.repeat(np.arange(len(facets)), nodes)))
    rank[order] = np.arange(len(points))
    triangles, odd = split(corners, rank)
    vectors, normals = area_vectors(points, corners), node_normals(points, corners)
    depth = thickness[triangles].mean(axis=1)
    share = np.linalg.norm(vectors, axis=1) * depth / 3
    used = np.zeros(len(points), dtype=bool)
    used[corners] = True

    well = np.logical_and.reduceat(used, starts)
    young, poisson = np.repeat(young * depth / depth, 3), np.repeat(poisson, 3)  # to the last bit as ``prisms`` has it
    local = triangles - shift
    inner = three_tets(local, local + np.repeat(nodes, counts)[:, None])
    sides = []
    for direction in (+1, -1):
        turn = direction * odd
        outer = points + thickness[:, None] * (direction * normals)
        well &= np.logical_and.reduceat(sound(points, outer, triangles, turn, share), ends - counts)
        cells = inner.copy()
        cells[turn < 0] = cells[turn < 0][:, :, [1, 0, 2, 3]]
        sides.append((outer, cells.reshape(-1, 4)))
    result = []
    for i, f in enumerate(facets):
        if not well[i]:
            result.append((prisms(f, +1), prisms(f, -1)))
            continue
        at, tets = slice(starts[i], starts[i] + nodes[i]), slice(3 * (ends[i] - counts[i]), 3 * ends[i])
        one, two = (Sole(outer[at], cells[tets], young[tets], poisson[tets]) for outer, cells in sides)
        result.append((one, two))
    return result
