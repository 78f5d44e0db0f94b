"""``element: auto``: four or ten nodes per tet, for this mesh and this matter.

On the same mesh ten-node tets cost several times as much and are better by more than that: their error falls with h²
where the solution is smooth, that of four-node tets with h, which are too stiff in bending and lock as ν goes to ½. So they
are taken, unless there is a reason not to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.quadratic import TET_EDGES, edges_of
from orchestrator.scene.model import Material

# Unknowns of ten-node tets beyond which they are not taken unasked: some 8 kB each, measured (assembly, 186,000 unknowns,
# 1.8 GB), a dozen GB. A number, not what is free here and now: the same input gives the same result everywhere.
LARGEST = 1_500_000
LOCKING = 0.45  # Poisson's ratio from which four-node tets move visibly too little


@dataclass(frozen=True)
class Choice:
    """P1 or P2, and why, in words."""

    element: str
    why: str

    def __str__(self) -> str:
        return f"{self.element}: {self.why}"


def choose_element(mesh: Mesh, materials: list[Material], cell_material: np.ndarray) -> Choice:
    """What to take for a mesh of four-node tets; materials and cell_material are empty where they are wrong, which is told elsewhere."""
    if mesh.foreign:
        return Choice("P1", "parts of other programs are met by four-node tets alone")
    unknowns = 3 * (len(mesh.nodes) + len(edges_of(mesh.cells, TET_EDGES)[0]))
    poisson = max((materials[m].poisson for m in np.unique(cell_material) if m >= 0), default=0.0) if materials else 0.0
    if unknowns > LARGEST:
        return Choice("P1", f"ten-node tets would have {unknowns:,} unknowns, which takes more memory than most machines have; but " + (
            f"four-node tets lock at ν = {poisson:g}: a coarser mesh with element: P2 is better" if poisson > LOCKING else
            "where there are fewer than four elements across a part, four-node tets are too stiff in bending"))
    if poisson > LOCKING:
        return Choice("P2", f"ν = {poisson:g}, at which four-node tets lock")
    return Choice("P2", f"{unknowns:,} unknowns are not many, and ten-node tets, not too stiff in bending, gain more accuracy than they cost")
