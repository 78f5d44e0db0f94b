"""Consistent nodal forces of tractions, pressures and body forces, per subdomain."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.conditions.materials import volumes_named
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.quadratic import TET_SHARES, TRIANGLE_SHARES
from orchestrator.scene.model import BoundaryEntry, Mesh
from orchestrator.scene.partition.numbering import SplitNumbering


def surface_loads(mesh: Mesh, boundary: list[BoundaryEntry], cell_subdomain: np.ndarray, numbering: SplitNumbering,
                  loads: np.ndarray) -> None:
    """Adds tractions and pressures to ``loads`` (steps, N, 3) on split nodes.

    A face loads the subdomain its tet belongs to. A traction gives each corner a third of the face's force, with
    six nodes each mid-edge node instead; a pressure acts against the outward normal.
    """
    for entry in boundary:
        if entry.kind == "displacement" or len(entry.triangles) == 0:
            continue
        at = numbering.find(cell_subdomain[entry.cells[:, 0]][:, None], entry.triangles)
        vectors, shares = area_vectors(mesh.nodes, entry.triangles), TRIANGLE_SHARES[entry.triangles.shape[1]]
        if entry.kind == "traction":
            weight = _gather(at, np.outer(np.linalg.norm(vectors, axis=1), shares), loads.shape[1])
            loads += weight[None, :, None] * entry.values[:, None, :]
        else:
            weight = np.stack([_gather(at, np.outer(-vectors[:, c], shares), loads.shape[1]) for c in range(3)], axis=1)
            loads += entry.values[:, 0, None, None] * weight


def body_loads(mesh: Mesh, entries: list[Any], vectors: list[list[list[float]]], numbering: SplitNumbering,
               loads: np.ndarray, problems: Problems) -> None:
    """Adds body forces (per volume) to ``loads`` (steps, N, 3) on split nodes; several on one volume add up.

    Parameters
    ----------
    vectors : per entry (steps, 3)
    """
    for i, (entry, rows) in enumerate(zip(entries, vectors)):
        cells = np.flatnonzero(np.isin(mesh.volume, volumes_named(mesh, entry.on, ("loads", i, "on"), problems)))
        volumes = tet_volumes(mesh.nodes, mesh.cells[cells])
        weight = _gather(numbering.corners[cells], np.outer(volumes, TET_SHARES[mesh.cells.shape[1]]), loads.shape[1])
        loads += weight[None, :, None] * np.array(rows, dtype=float)[:, None, :]


def _gather(at: np.ndarray, share: np.ndarray, size: int) -> np.ndarray:
    """(size,) sums of the shares (k, p) of elements' nodes ``at`` (k, p)."""
    return np.bincount(at.reshape(-1), weights=share.reshape(-1), minlength=size)
