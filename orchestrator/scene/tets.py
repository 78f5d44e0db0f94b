"""How good tets are."""

from __future__ import annotations

import numpy as np

from orchestrator.scene.faces import LOCAL_FACES, area_vectors, tet_volumes

# Two faces at each of the six edges.
PAIRS = [(i, j) for i in range(4) for j in range(i)]


def roundness(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(m,) gmsh's gamma: radius of the inscribed ball over the longest edge, 1 for the regular tet, < 0 if inverted."""
    area = sum(np.linalg.norm(area_vectors(nodes, cells[:, face]), axis=1) for face in LOCAL_FACES)
    longest = np.sqrt(np.max([np.sum((nodes[cells[:, i]] - nodes[cells[:, j]]) ** 2, axis=1) for i, j in PAIRS], axis=0))
    return 6 * np.sqrt(6) * tet_volumes(nodes, cells) / (area * longest)


def dihedral_range(nodes: np.ndarray, cells: np.ndarray) -> tuple[float, float]:
    """Smallest and largest angle in degrees between two faces of a tet."""
    normals = [area_vectors(nodes, cells[:, face]) for face in LOCAL_FACES]
    normals = [normal / np.linalg.norm(normal, axis=1)[:, None] for normal in normals]
    cosines = np.array([np.einsum("ij,ij->i", normals[i], normals[j]) for i, j in PAIRS])
    # Outward normals make the angle's supplement.
    sharp, blunt = np.degrees(np.arccos(np.clip([-cosines.min(), -cosines.max()], -1, 1)))
    return float(sharp), float(blunt)
