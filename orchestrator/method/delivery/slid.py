"""How far sides have slid whose pairs stay as they are, and what that makes amiss: two numbers for each interface.

A point meets what was opposite it before loading, along its own normal n. Having slid by s it should meet a place where the other
side's normal is m and turns by ∇m s on the way: the distance is off by

    s·(m − n) + s·∇(m − n)·s / 2

which is nothing where surfaces conform, as a shaft and its bore, or are plane. A distance e that is amiss within an element of size h
is a pressure of E e/h, so that pressures are off by the share that e has of p h/E, or of a press fit that is more than that.
"""

from __future__ import annotations

import numpy as np

from orchestrator.laws.points import table
from orchestrator.method.delivery.interface_fields import InterfaceFields
from orchestrator.scene.interfaces.opposite import Facets
from orchestrator.scene.interfaces.skins import SMOOTH, surface_of
from orchestrator.scene.interfaces.mortar.operators import scalar
from orchestrator.scene.mesh.geometry import node_vectors, unit
from orchestrator.scene.mesh.quadratic import LUMPED_SHARES
from orchestrator.scene.interface import Interface
from orchestrator.scene.model import Scene


def slides(scene: Scene, fields: InterfaceFields, interfaces: list[Interface]) -> tuple[np.ndarray, np.ndarray]:
    """(I,) how far sides have slid, in elements, and (I,) what that makes amiss; nan where pairs follow. ``interfaces`` : those of the fields."""
    holds = np.isin(fields.status, [s for s in table(i.law for i in scene.interfaces) if s.holds])
    slip, (far, amiss) = np.where(holds[..., None], fields.slip, 0.0), np.full((2, len(interfaces)), np.nan)
    for i, (k, own) in zip(interfaces, fields.each()):
        if i.law.follows or i.law.on_ground or i.tool is not None:
            continue
        facets = fields.triangles[fields.owner == k]
        corners = fields.points[0, facets]
        size = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
        far[k] = float(np.linalg.norm(slip[:, own], axis=2).max(initial=0.0)) / size
        amiss[k] = _amiss(scene, i, fields, slip, own, facets) if far[k] > 0 else 0.0
    return far, amiss


def _amiss(scene: Scene, i: Interface, fields: InterfaceFields, slip: np.ndarray, own: slice, facets: np.ndarray) -> float:
    """The largest distance that is amiss, over the largest that presses.

    slip : (T, N, 3), zero where nothing holds; own : the interface's of the N nodes; facets : (m, 3) int, indices into the N
    """
    normals = np.zeros((len(fields.nodes), 3))
    normals[own] = _turn(scene, i)
    if not normals.any():
        return 0.0
    shape = Facets.of(fields.points[0, facets])
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
    there = unit(scalar(i.mortar.second) @ two)
    result = np.zeros_like(one)
    result[i.mortar.points] = np.where(there.any(axis=1)[:, None], there - one[i.mortar.points], 0.0)
    return result[i.shown]


def _normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals of the surface that facets on points (n, 3) stand for."""
    known = surface_of(points, triangles, np.full(len(triangles), -1)).normals
    return unit(node_vectors(points, triangles, LUMPED_SHARES[triangles.shape[1]], known))
