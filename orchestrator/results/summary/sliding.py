"""Sentences on sides that have slid farther than pairs that stay as they are can tell.

A point meets what was opposite it before loading, along its own normal n. Having slid by s it should meet a place where the other
side's normal is m and turns by ∇m s on the way: the distance is off by

    s·(m − n) + s·∇(m − n)·s / 2

which is nothing where surfaces conform, as a shaft and its bore, or are plane. A distance e that is amiss within an element of size h
is a pressure of E e/h, so that pressures are off by the share that e has of p h/E, or of a press fit that is more than that.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orchestrator.errors import some
from orchestrator.laws.points import table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.interfaces.mortar.operators import unit
from orchestrator.scene.interfaces.opposite import Facets
from orchestrator.scene.interfaces.skins import SMOOTH, surface_of
from orchestrator.scene.mesh.geometry import node_normals
from orchestrator.scene.model import Interface, Scene

# Slips beyond this share of an element are told; beyond the whole of it pairs no longer face each other.
FIFTH = 0.2
# Shares of pressures, by which curved sides that slide may have them wrong, from which they are told.
WRONG = 0.1


def sliding(scene: Scene, fields: InterfaceFields) -> Iterator[str]:
    """A sentence for those that slid by more than an element, by more than a fifth, and on curved faces by too much for these."""
    far, bent = slides(scene, fields), {}
    slip = _held_slip(scene, fields)
    for i, name, own, facets in _fixed(scene, fields):
        bent[name] = _amiss(scene, i, fields, slip, own, facets) if far[name] > 0 else 0.0
    if much := [name for name, share in far.items() if share > 1]:
        yield (f"{some(much)} slid by more than an element: node pairs do not follow, "
               "large sliding is outside small perturbations; between parts meshed each on its own contact has pairing: follow")
    if more := {name: share for name, share in far.items() if FIFTH < share <= 1}:
        yield (f"{some(sorted(more, key=more.get, reverse=True))} slid by up to {max(more.values()):.2g} of an element: node pairs do not "
               "follow, and forces act where they did before loading; between parts meshed each on its own contact has pairing: follow")
    if wrong := {name: share for name, share in bent.items() if share > WRONG and far[name] <= 1}:
        yield (f"{some(sorted(wrong, key=wrong.get, reverse=True))} slid on curved faces that do not conform: pressures may be off by "
               f"{min(max(wrong.values()), 1.0):.0%} of the largest, as node pairs do not follow; between parts meshed each on its own "
               "contact has pairing: follow")


def slides(scene: Scene, fields: InterfaceFields) -> dict[str, float]:
    """Interface → how far its sides have slid, in elements, where they hold; of those whose pairs stay as they are."""
    slip, corners = _held_slip(scene, fields), scene.mesh.nodes[fields.nodes]
    far = {}
    for _, name, own, facets in _fixed(scene, fields):
        size = float(np.linalg.norm(corners[facets] - np.roll(corners[facets], 1, axis=1), axis=2).mean())
        far[name] = float(np.linalg.norm(slip[:, own], axis=2).max(initial=0.0)) / size
    return far


def _fixed(scene: Scene, fields: InterfaceFields) -> Iterator[tuple[Interface, str, slice, np.ndarray]]:
    """Interfaces whose pairs stay as they are: name, which of the fields' N nodes are theirs, and their facets (m, 3)."""
    fixed = {i.name: i for i in scene.interfaces if not (i.law.follows or i.law.on_ground or i.tool is not None)}
    for k, own in fields.each():
        if (name := str(fields.names[k])) in fixed:
            yield fixed[name], name, own, fields.triangles[fields.owner == k]


def _held_slip(scene: Scene, fields: InterfaceFields) -> np.ndarray:
    """(T, N, 3) slip, zero where nothing holds."""
    holds = np.isin(fields.status, [s for s in table(i.law for i in scene.interfaces) if s.holds])
    return np.where(holds[..., None], fields.slip, 0.0)


def _amiss(scene: Scene, i: Interface, fields: InterfaceFields, slip: np.ndarray, own: slice, facets: np.ndarray) -> float:
    """The largest distance that is amiss, over the largest that presses.

    slip : (T, N, 3), zero where nothing holds; own : the interface's of the N nodes; facets : (m, 3) int, indices into the N
    """
    normals = np.zeros((len(fields.nodes), 3))
    normals[own] = _turn(scene, i)
    if not normals.any():
        return 0.0
    shape = Facets.of(scene.mesh.nodes[fields.nodes][facets])
    cosine = np.einsum("mvi,mvi->mv", fields.normal[facets], np.roll(fields.normal[facets], 1, axis=1)).min(axis=1)
    # normals of the other side are means over as much as a facet: what they differ by from surfaces that conform
    apart = (np.linalg.norm(normals[facets], axis=2) > 1 - cosine[:, None]).any(axis=1)
    mean = slip[:, facets].mean(axis=2)
    turned = np.einsum("mvi,mvj,tmj->tmi", normals[facets], shape.slopes, mean)
    off = np.einsum("tmi,tmi->tm", mean, normals[facets].mean(axis=1) + turned / 2)
    young = min(scene.materials[m].young for m in np.unique(scene.cell_material[i.cells]))
    presses = fields.pressure[:, facets].mean(axis=2) * shape.size / young
    scale = max(float(presses.max(initial=0.0)), float(-fields.initial_gap[own].min(initial=0.0)))
    held = (cosine > SMOOTH) & apart & (presses > 0)
    return float(np.abs(np.where(held, off, 0.0)).max(initial=0.0)) / scale if scale > 0 else 0.0


def _turn(scene: Scene, i: Interface) -> np.ndarray:
    """(c, 3) by how much the other side's unit normals differ from an interface's own, at the nodes shown; 0 where nothing is opposite."""
    points, other = (scene.side_points(i, side) for side in (0, 1))
    if i.paired and np.array_equal(points, other):  # as where one mesh was cut: the same facets
        return np.zeros_like(points)[i.shown]
    one, two = _normals(points, i.triangles), _normals(other, i.triangles_on(1))
    if i.paired:
        return (two - one)[i.shown]
    there = unit(i.mortar.second[::3, ::3] @ two)
    result = np.zeros_like(one)
    result[i.mortar.points] = np.where(there.any(axis=1)[:, None], there - one[i.mortar.points], 0.0)
    return result[i.shown]


def _normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals of the surface that facets on points (n, 3) stand for."""
    return node_normals(points, triangles, surface_of(points, triangles, np.full(len(triangles), -1)).normals)
