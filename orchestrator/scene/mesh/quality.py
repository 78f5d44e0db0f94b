"""Is this a mesh, and how good are its tets? Orientation, volumes, faces: what must hold before anything is computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orchestrator.errors import Problems
from orchestrator.scene.mesh.faces import LOCAL_FACES, MAX_NODES, Faces, faces_of
from orchestrator.scene.mesh.geometry import area_vectors, cross, tet_volumes
from orchestrator.scene.mesh.mesh import Mesh

# Two corners, or the two faces, of each of the six edges.
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


# A tet is flat when its volume is below this share of its longest edge cubed.
FLAT = 1e-10


def checked(mesh: Mesh) -> tuple[Mesh, Faces]:
    """The mesh with positive tets, and its faces; one whose tets are all inverted follows another convention and is turned round.

    Raises InputError: no tets, too many nodes, coordinates that are no numbers, inverted or flat tets,
        faces of three tets, overlapping tets
    """
    problems = Problems()

    def complain(found: str, expected: str, cure: str) -> None:
        problems.add(("mesh",), f"{mesh.source}: {found}", expected, cure)

    bad = np.flatnonzero(~np.isfinite(mesh.nodes).all(axis=1))
    if len(mesh.cells) == 0:
        complain("no tetrahedra", "a mesh of four-node tetrahedra", "mesh the volume, not only its surface, and save the volume elements")
    elif len(mesh.nodes) > MAX_NODES:
        complain(f"{len(mesh.nodes)} nodes", f"at most {MAX_NODES} nodes", "use a coarser mesh")
    elif len(bad):
        complain(f"node {bad[0]} at {mesh.nodes[bad[0]]}", "finite coordinates", "write the mesh file again")
    problems.raise_if_any()
    inverted, flat = _inverted(mesh)
    if inverted.any() and (inverted | flat).all():
        mesh, inverted = replace(mesh, cells=mesh.cells[:, [0, 2, 1, 3]]), np.zeros_like(inverted)
    for what, bad, cure in (
            ("inverted", inverted, "swap two nodes of these tets, or mesh again: elements overlap here"),
            ("zero-volume", flat, "remove these tets, or optimise the mesh (gmsh: -optimize_netgen)")):
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            complain(f"{bad.sum()} {what} of {len(bad)} tets; the first is cell {first} at "
                     f"{format_point(mesh.nodes[mesh.cells[first]].mean(axis=0))}", "tets of positive volume, all oriented the same way", cure)
    problems.raise_if_any()  # bad tets have bad faces: a second complaint would only distract
    faces = faces_of(mesh.cells, len(mesh.nodes))
    for what, index, cure in (
            ("faces shared by three or more tets", faces.crowded, "remove duplicated tets"),
            ("faces with both tets on the same side", np.setdiff1d(faces.folded, faces.crowded), "remove duplicated or overlapping tets")):
        if len(index):
            complain(f"{len(index)} {what}, the first at {format_point(mesh.nodes[faces.triangles[index[0]]].mean(axis=0))}",
                     "each face between at most two tets, one on either side", cure)
    problems.raise_if_any()
    return mesh, faces


def _inverted(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(m,) bool each, which tets are inverted, and which are flat."""
    volumes = tet_volumes(mesh.nodes, mesh.cells)
    flat = np.abs(volumes) <= FLAT * mesh.diagonal ** 3  # no edge is longer than that
    thin = np.flatnonzero(flat)
    corners = mesh.nodes[mesh.cells[thin]]
    longest = np.max([np.sum((corners[:, i] - corners[:, j]) ** 2, axis=1) for i, j in PAIRS], axis=0) ** 1.5
    flat[thin] = np.abs(volumes[thin]) <= FLAT * longest
    return (volumes < 0) & ~flat, flat


def format_point(point: np.ndarray) -> str:
    """Coordinates for a message: (1, 2.5, 0)."""
    return "(" + ", ".join(f"{float(x) + 0.0:.6g}" for x in point) + ")"
