"""Meshes as text of gmsh's format 2.2, for scenes whose parts are read from files; those of rings."""

from __future__ import annotations

import numpy as np

# A hexahedron's six tets by the bits of its corners: Kuhn's division, whose diagonals meet the neighbours'.
HEX = np.array([[0, 1, 3, 7], [0, 1, 5, 7], [0, 4, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 6, 7]])


def ring(inner: float, outer: float, height: float, sectors: int, layers: int, rows: int) -> str:
    """Return the mesh of a ring about z: surfaces inner, outer, bottom and top, one volume.

    inner, outer, height : radii and height; sectors, layers, rows : cells around, across and along
    """
    r, z = np.linspace(inner, outer, layers + 1), np.linspace(0, height, rows + 1)
    angle = 2 * np.pi * np.arange(sectors) / sectors
    number = np.arange(sectors * (layers + 1) * (rows + 1)).reshape(sectors, layers + 1, rows + 1)
    a, b, c = np.meshgrid(angle, r, z, indexing="ij")
    nodes = np.stack([b * np.cos(a), b * np.sin(a), c], axis=-1).reshape(-1, 3)
    around = np.roll(number, -1, axis=0)
    corners = np.stack([(around if i else number)[:, j:layers + j, k:rows + k]
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)], axis=-1).reshape(-1, 8)
    cells = corners[:, HEX].reshape(-1, 4)
    x = nodes[cells]
    wrong = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    cells[wrong] = cells[wrong][:, [1, 0, 2, 3]]
    return text_of(nodes, cells, {"inner": number[:, 0], "outer": number[:, -1],
                                "bottom": number[..., 0], "top": number[..., -1]})


def text_of(nodes: np.ndarray, cells: np.ndarray, surfaces: dict[str, np.ndarray]) -> str:
    """Return the file of a mesh of one volume; surfaces: name to the numbers of all nodes that lie on it."""
    faces = np.sort(cells[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
    different, count = np.unique(faces, axis=0, return_counts=True)
    outside, rows, names = different[count == 1], [], ["volume"]
    for name, there in surfaces.items():
        names.append(name)
        on = outside[np.isin(outside, there).all(axis=1)] + 1
        rows += [f"2 2 {len(names)} {len(names)} {' '.join(map(str, t))}" for t in on]
    rows += [f"4 2 1 1 {' '.join(map(str, t))}" for t in cells + 1]
    groups = [f'{3 if name == "volume" else 2} {k} "{name}"' for k, name in enumerate(names, 1)]
    points = [f"{k} {x!r} {y!r} {w!r}" for k, (x, y, w) in enumerate(nodes.tolist(), 1)]
    return "\n".join(["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(groups)), *groups,
                      "$EndPhysicalNames", "$Nodes", str(len(nodes)), *points, "$EndNodes", "$Elements", str(len(rows)),
                      *(f"{k} {row}" for k, row in enumerate(rows, 1)), "$EndElements", ""])
