"""Consistent nodal forces of tractions, pressures and body forces, per subdomain."""

from __future__ import annotations

from typing import Any

import numpy as np

from orchestrator.config.turning import unit
from orchestrator.errors import Problems
from orchestrator.scene.conditions.affine import nodal
from orchestrator.scene.conditions.materials import cells_loaded
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.quadratic import TET_MOMENTS, TET_SHARES, TRIANGLE_SHARES
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import BoundaryEntry
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
        if entry.varies:
            forces = nodal(entry, mesh.nodes)
            for step, c in np.ndindex(len(forces), 3):
                loads[step, :, c] += _gather(at, forces[step, :, :, c], loads.shape[1])
            continue
        vectors, shares = area_vectors(mesh.nodes, entry.triangles), TRIANGLE_SHARES[entry.triangles.shape[1]]
        if entry.kind == "traction":
            weight = _gather(at, np.outer(np.linalg.norm(vectors, axis=1), shares), loads.shape[1])
            loads += weight[None, :, None] * entry.values[:, None, :]
        else:
            weight = np.stack([_gather(at, np.outer(-vectors[:, c], shares), loads.shape[1]) for c in range(3)], axis=1)
            loads += entry.values[:, 0, None, None] * weight


def body_loads(mesh: Mesh, entries: list[Any], vectors: list[list[list[float]] | None], factors: list[list[float]],
               density: list[float | None], cell_material: np.ndarray, numbering: SplitNumbering, loads: np.ndarray,
               problems: Problems) -> None:
    """Adds body forces (per volume) to ``loads`` (steps, N, 3) on split nodes; several on one volume add up.

    Parameters
    ----------
    vectors : per entry (steps, 3); None for gravity and spin
    factors : per entry (steps,) what multiplies it
    density : per material, None where it has none; cell_material : (m,) int
    """
    for i, (entry, rows) in enumerate(zip(entries, vectors)):
        if entry.temperature is not None:  # see ``heat``
            continue
        cells = cells_loaded(mesh, entry.on, ("loads", i, "on"), problems)
        volumes = tet_volumes(mesh.nodes, mesh.cells[cells])
        if rows is None:
            kind = "gravity" if entry.gravity is not None else "spin"
            weightless = sorted({int(m) for m in cell_material[cells] if m >= 0 and density[m] is None})
            if weightless:
                problems.add(("loads", i, kind), f"matter without density: materials[{weightless[0]}]",
                             "a density of all the matter it acts on", "add density: to the material, mass per volume in "
                             "your units (steel in t, mm, s: 7.85e-9)")
                continue
            mass = volumes * np.array([density[m] for m in cell_material[cells]], dtype=float)
        if rows is not None or kind == "gravity":
            amount = volumes if rows is not None else mass
            force = np.array(rows, dtype=float) if rows is not None else np.outer(factors[i], entry.gravity)
            weight = _gather(numbering.corners[cells], np.outer(amount, TET_SHARES[mesh.cells.shape[1]]), loads.shape[1])
            loads += weight[None, :, None] * force[:, None, :]
        else:
            pull = _centrifugal(mesh, cells, mass, entry.spin)
            each = np.stack([_gather(numbering.corners[cells], pull[:, :, c], loads.shape[1]) for c in range(3)], axis=1)
            loads += np.asarray(factors[i], dtype=float)[:, None, None] * each


def _centrifugal(mesh: Mesh, cells: np.ndarray, mass: np.ndarray, spin: Any) -> np.ndarray:
    """(k, 4 or 10, 3) forces ∫ φ ρ ω² r of a steady rotation, r from the axis."""
    axis = np.array(unit(spin.axis))
    corners = mesh.nodes[mesh.cells[cells, :4]] - np.array(spin.about, dtype=float)
    outward = spin.rate**2 * (corners - (corners @ axis)[..., None] * axis)  # linear on every tet
    return np.einsum("k,ab,kbi->kai", mass, TET_MOMENTS[mesh.cells.shape[1]], outward)


def _gather(at: np.ndarray, share: np.ndarray, size: int) -> np.ndarray:
    """(size,) sums of the shares (k, p) of elements' nodes ``at`` (k, p)."""
    return np.bincount(at.reshape(-1), weights=share.reshape(-1), minlength=size)
