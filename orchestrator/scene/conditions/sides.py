"""What is prescribed on both sides of an interface against what its law lets happen: the iterations leave such nodes out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.conditions.boundary import Held
from orchestrator.scene.conditions.selection import TOLERANCE
from orchestrator.scene.mesh.geometry import area_vectors, format_point, node_normals
from orchestrator.scene.model import Interface

CURVED = 0.2  # of a jump, what may point into a curved side: normals at nodes are means of facets
TURNED = 0.01  # of what a frame prescribes, what may differ between nodes and the facets between them


def check_sides(held: Held, interfaces: Sequence[Interface], problems: Problems) -> None:
    """Adds a problem for each interface whose sides are prescribed to do what its law forbids whatever the force.

    Bonds and jumps of paired nodes are judged by ``check_agreement``.
    """
    mesh, held_by, prescribed = held.mesh, held.by, held.values
    slack = TOLERANCE * held.changes()
    for i in interfaces:
        if i.matching and i.law.given_jump is not None:
            continue
        own = held.sides(i)
        if not all((held_by[side] >= 0).any() for side in own):
            continue
        points, triangles = (mesh.nodes[i.global_nodes], i.triangles) if i.matching else (i.surfaces.points[0], i.surfaces.triangles[0])
        at = np.arange(len(own[0]))
        place, others, weight, apart = (at, at[:, None], np.ones((len(at), 1)), np.zeros(len(at))) if i.matching else _opposite(i)
        one, two = own[0][place], own[1][others]
        known = (held_by[one] >= 0) & ((held_by[two] >= 0) | (weight == 0)[:, :, None]).all(axis=1)
        jump = np.einsum("pk,tpkc->tpc", weight, prescribed[:, two]) - prescribed[:, one]
        by = np.concatenate([held_by[one][:, None], held_by[two]], axis=1)  # (pairs, 1 + k, 3)
        same = i.law.perfect & (by == by[:, :1]).all(axis=1)
        size = np.maximum(np.abs(prescribed[:, one]).max(axis=2), np.abs(prescribed[:, two]).max(axis=(2, 3)))
        allowed = TOLERANCE * size + (slack[by].max(axis=(1, 2)) * (1 + apart / (TOLERANCE * (mesh.diagonal or 1.0)))[:, None]).T
        turned = np.array([bool(entry.prescribed) and entry.prescribed.field.turns for entry in held.boundary])[by].any(axis=(1, 2))
        normals = node_normals(points, triangles)
        flat = area_vectors(points, triangles)
        flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
        curved = (flat @ flat[0]).min() < 1 - TOLERANCE
        laws = i.law_at_steps or [i.law] * len(jump)
        wrong = np.stack([law.forbids(d, known & ~same, normals[place], place) for law, d in zip(laws, jump)])
        share = np.where(turned, TURNED, 0.0) * size
        if curved and i.law.given_jump is None:
            share = share + CURVED * np.linalg.norm(jump, axis=2)
        if not (bad := wrong > allowed + share).any():
            continue
        step, worst = np.unravel_index(int(np.where(bad, wrong, 0.0).argmax()), wrong.shape)
        entries = sorted({int(e) for e in by[worst].ravel() if e >= 0})
        problems.add(("boundary", entries[-1]), f"{' and '.join(f'boundary[{e}]' for e in entries)} on both sides of {i.name}, at "
                     f"{format_point(points[place[worst]])} and {len(np.unique(place[bad.any(axis=0)]))} nodes in all, move the second by "
                     f"{format_point(jump[step, worst])} against the first at load step {step + 1}, which law: {i.law.name} forbids, by "
                     f"{wrong[step, worst]:.3g}", "displacements on both sides that the interface between them lets happen",
                     "prescribe the same on both, free a component of one with null, or select faces that end before the other part")


def _opposite(interface: Interface) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where corners of the slave lie on the master's facets.

    Returns place : (p,) int, nodes of the slave; others : (p, 3) int, nodes of the master; weight : (p, 3) shares of these, that sum up to 1
    apart : (p,) how far the two places are from each other
    """
    s = interface.surfaces
    pairs = np.unique(np.c_[s.triangles[0][s.segments.slave, :3].ravel(), np.repeat(s.segments.master, 3)], axis=0)
    place, others = pairs[:, 0], s.triangles[1][pairs[:, 1], :3]
    x, corners = s.points[0][place], s.points[1][others]
    edges = corners[:, 1:] - corners[:, :1]
    gram = np.einsum("pax,pbx->pab", edges, edges)
    two = np.linalg.solve(gram, np.einsum("pax,px->pa", edges, x - corners[:, 0])[:, :, None])[:, :, 0]
    weight = np.c_[1 - two.sum(axis=1), two]
    inside = weight.min(axis=1) >= -TOLERANCE
    place, others, weight, x, corners = place[inside], others[inside], weight[inside], x[inside], corners[inside]
    weight = np.where(weight > TOLERANCE, weight, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    return place, others, weight, np.linalg.norm(np.einsum("pk,pkx->px", weight, corners) - x, axis=1)
