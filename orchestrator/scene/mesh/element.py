"""``element: auto``: four or ten nodes per tet, for this mesh and this matter.

On the same mesh ten-node tets cost several times as much and are better by more than that: their error falls with h²
where the solution is smooth, that of four-node tets with h, which are too stiff in bending and lock as ν goes to ½. So they
are taken, unless there is a reason not to; what weighs most in the scene is told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.geometry import area_vectors, tet_volumes
from orchestrator.scene.mesh.quadratic import TET_EDGES, TET_MOMENTS, edges_of
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.model import Material

# Unknowns of ten-node tets beyond which they are not taken unasked: some 8 kB each, measured (assembly, 186,000 unknowns,
# 1.8 GB), a dozen GB. A number, not what is free here and now: the same input gives the same result everywhere.
LARGEST = 1_500_000
# Four-node tets across a thickness that are few: a plate of four is some tenth too stiff in bending.
FEW = 4.0
LOCKING = 0.45  # Poisson's ratio from which four-node tets move visibly too little


@dataclass(frozen=True)
class Choice:
    """P1 or P2, and why, in words."""

    element: str
    why: str

    def __str__(self) -> str:
        return f"{self.element}: {self.why}"


def choose_element(mesh: Mesh, faces: Faces, materials: list[Material], cell_material: np.ndarray) -> Choice:
    """What to take.

    Parameters
    ----------
    mesh : of four-node tets
    materials, cell_material : of the scene; empty where they are wrong, which is complained of elsewhere
    """
    if mesh.foreign:
        return Choice("P1", "parts of other programs are met by four-node tets alone")
    unknowns = 3 * (len(mesh.nodes) + len(edges_of(mesh.cells, TET_EDGES)[0]))
    poisson = max((materials[m].poisson for m in np.unique(cell_material) if m >= 0), default=0.0) if materials else 0.0
    across, part = _across(mesh, faces)
    if unknowns > LARGEST:
        reasons = [f"ten-node tets would have {unknowns:,} unknowns, which takes more memory than most machines have"]
        if poisson > LOCKING:
            reasons.append(f"but four-node tets lock at ν = {poisson:g}: a coarser mesh with element: P2 is better")
        elif across < FEW:
            reasons.append(f"but there are only about {across:.1f} elements across {part}: in bending four-node tets are too stiff")
        return Choice("P1", "; ".join(reasons))
    if poisson > LOCKING:
        return Choice("P2", f"ν = {poisson:g}, at which four-node tets lock")
    if across < FEW:
        return Choice("P2", f"only about {across:.1f} elements across {part}, where four-node tets are too stiff in bending")
    return Choice("P2", f"{unknowns:,} unknowns are not many, and ten-node tets gain more accuracy than they cost")


def _across(mesh: Mesh, faces: Faces) -> tuple[float, str]:
    """About how many elements there are across the volume where they are fewest, and which one that is.

    A thickness is the shortest side of the box with the same moments of inertia, at most 4 V/A, as of a bar: of plates that
    are bent or joined at an angle no box tells. The size of a tet is the edge of the cube that six of it fill.
    """
    count = len(mesh.volumes)
    each = tet_volumes(mesh.nodes, mesh.cells)
    total = np.bincount(mesh.volume, weights=each, minlength=count)
    size = np.cbrt(6 * total / np.maximum(np.bincount(mesh.volume, minlength=count), 1))
    outer = faces.neighbour < 0
    border = ~outer
    border[border] = mesh.volume[faces.owner[border]] != mesh.volume[faces.neighbour[border]]
    areas = np.linalg.norm(area_vectors(mesh.nodes, faces.triangles), axis=1)
    area = np.bincount(mesh.volume[faces.owner[outer | border]], weights=areas[outer | border], minlength=count)
    area += np.bincount(mesh.volume[faces.neighbour[border]], weights=areas[border], minlength=count)
    fewest, part = np.inf, ""
    for v in np.flatnonzero(total > 0).tolist():
        own = mesh.volume == v
        corners = mesh.nodes[mesh.cells[own]]
        centre = each[own] @ corners.mean(axis=1) / total[v]
        second = np.einsum("k,ab,kax,kby->xy", each[own], TET_MOMENTS[4], corners - centre, corners - centre) / total[v]
        thick = min(np.sqrt(12 * max(np.linalg.eigvalsh(second)[0], 0.0)), 4 * total[v] / area[v])
        if thick / size[v] < fewest:
            fewest, part = float(thick / size[v]), mesh.volumes[v]
    return fewest, part
