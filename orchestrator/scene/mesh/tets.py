"""How good tets are."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.mesh.faces import LOCAL_FACES
from orchestrator.scene.mesh.geometry import area_vectors, cross, tet_volumes

# Two faces at each of the six edges.
PAIRS = [(i, j) for i in range(4) for j in range(i)]


def roundness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) gmsh's gamma: three radii of the inscribed ball over that of the circumscribed one; 1 is regular, < 0 inverted."""
    area = sum(np.linalg.norm(area_vectors(nodes, cells[:, face]), axis=1) for face in LOCAL_FACES)
    volume = tet_volumes(nodes, cells)
    a, b, c = (nodes[cells[:, i]] - nodes[cells[:, 0]] for i in (1, 2, 3))
    # From the first corner to the ball's centre, times twelve volumes.
    centre = sum(np.einsum("ij,ij->i", p, p)[:, None] * cross(q, r) for p, q, r in ((a, b, c), (b, c, a), (c, a, b)))
    return 108 * volume * np.abs(volume) / (area * np.linalg.norm(centre, axis=1))


def dihedral_angles(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m,) smallest and (m,) largest angle in degrees between two faces of each tet; nan where a face has no area."""
    normals = [area_vectors(nodes, cells[:, face]) for face in LOCAL_FACES]
    with np.errstate(invalid="ignore"):
        normals = [normal / np.linalg.norm(normal, axis=1)[:, None] for normal in normals]
    cosines = np.array([np.einsum("ij,ij->i", normals[i], normals[j]) for i, j in PAIRS])
    # Outward normals make the angle's supplement.
    sharp, blunt = np.degrees(np.arccos(np.clip([-cosines.min(axis=0), -cosines.max(axis=0)], -1, 1)))
    return sharp, blunt


def dihedral_range(nodes: np.ndarray, cells: np.ndarray) -> tuple[float, float]:
    """Smallest and largest angle in degrees between two faces of a tet."""
    sharp, blunt = dihedral_angles(nodes, cells)
    return float(sharp.min()), float(blunt.max())
