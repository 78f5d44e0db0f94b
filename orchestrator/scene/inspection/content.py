"""Volumes and surfaces of a mesh, with what one wants to know before naming them in a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.model import Mesh

# Facets whose normals differ by less than this from their mean make a plane surface.
PLANE = 1e-6


@dataclass(frozen=True)
class VolumeRow:
    """One named volume: number of tets, volume, mean element size (cube root of six tets' volume), lowest and highest corner."""

    name: str
    tets: int
    volume: float
    size: float
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class SurfaceRow:
    """One named surface: number of triangles, area, centre, and its normal (3,) where it is plane."""

    name: str
    triangles: int
    area: float
    centre: np.ndarray
    normal: np.ndarray | None


def volumes_of(mesh: Mesh) -> Iterator[VolumeRow]:
    """In the order of the mesh."""
    each = tet_volumes(mesh.nodes, mesh.cells)
    for index, name in enumerate(mesh.volumes):
        own = mesh.volume == index
        points = mesh.nodes[np.unique(mesh.cells[own, :4])]
        yield VolumeRow(name, int(own.sum()), float(each[own].sum()), float(np.cbrt(6 * each[own].mean())),
                        points.min(axis=0), points.max(axis=0))


def surfaces_of(mesh: Mesh) -> Iterator[SurfaceRow]:
    """In the order of the mesh."""
    for name, triangles in mesh.surfaces.items():
        vectors = area_vectors(mesh.nodes, triangles)
        each = np.linalg.norm(vectors, axis=1)
        area = float(each.sum())
        if not area:
            yield SurfaceRow(name, len(triangles), 0.0, np.full(3, np.nan), None)
            continue
        centre = each @ mesh.nodes[triangles[:, :3]].mean(axis=1) / area
        mean = vectors.sum(axis=0) / area
        plane = np.abs(vectors / each[:, None] - mean).max() < PLANE
        yield SurfaceRow(name, len(triangles), area, centre, mean if plane else None)
