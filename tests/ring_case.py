"""A quarter of a ring: the box of bricks bent, radius along x, angle along y, named sides inner, outer, start, end, low, high."""

import meshio
import numpy as np

from orchestrator.scene.mesh.sources import bricks

SIDES = {"xmin": "inner", "xmax": "outer", "ymin": "start", "ymax": "end", "zmin": "low", "zmax": "high"}


def ring(path, inner: float, outer: float, thick: float, cells: tuple[int, int, int]) -> np.ndarray:
    """Writes the mesh; returns its nodes (n, 3). The start is on the plane y = 0, the end on x = 0."""
    mesh = bricks(np.ones(3), np.array(cells), "ring")
    # finer towards the inside, as stresses are
    r, angle = inner * (outer / inner) ** mesh.nodes[:, 0], mesh.nodes[:, 1] * np.pi / 2
    points = np.c_[r * np.cos(angle), r * np.sin(angle), thick * mesh.nodes[:, 2]]
    points[np.abs(points) < 1e-12 * outer] = 0.0
    names = list(mesh.surfaces)
    triangles = np.concatenate([mesh.surfaces[name] for name in names])
    group = np.repeat(np.arange(2, 2 + len(names)), [len(mesh.surfaces[name]) for name in names])
    made = meshio.Mesh(points, [("tetra", mesh.cells), ("triangle", triangles)],
                       cell_data={key: [np.ones(len(mesh.cells), int), group] for key in ("gmsh:physical", "gmsh:geometrical")},
                       field_data={"ring": np.array([1, 3]), **{SIDES[name]: np.array([k, 2]) for k, name in enumerate(names, 2)}})
    meshio.write(path, made, "gmsh22", binary=False)
    return points
