"""What one sees of a mesh: outer faces, and the edges worth a line. VTK's filters find them, through pyvista.

The run names what is to be drawn and leaves it to another process: pyvista is imported where it is used.
"""

from __future__ import annotations

import numpy as np

SHARP = 30.0  # degrees by which neighbouring faces turn


def outer_faces(nodes: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces that belong to one tet only; those of a ten-node tet in four triangles each.

    Parameters
    ----------
    nodes : (n, 3); cells : (m, 4 or 10) int, VTK's order

    Returns
    -------
    triangles : (k, 3) node ids, oriented outward; cell : (k,) the tet of each
    """
    import pyvista

    kind = {4: pyvista.CellType.TETRA, 10: pyvista.CellType.QUADRATIC_TETRA}[cells.shape[1]]
    grid = pyvista.UnstructuredGrid({kind: cells}, nodes)
    grid.point_data["node"], grid.cell_data["cell"] = np.arange(len(nodes)), np.arange(len(cells))
    surface = grid.extract_surface(algorithm="dataset_surface", pass_pointid=False, pass_cellid=False)
    return surface["node"][surface.regular_faces], surface["cell"]


def edges(nodes: np.ndarray, triangles: np.ndarray, part: np.ndarray | None = None,
          sharp: float = SHARP) -> np.ndarray:
    """(e, 2) node ids of the edges where faces turn sharply, at borders between parts, and of open rims.

    Parameters
    ----------
    nodes : (n, 3); triangles : (k, 3) int
    part : (k,) int, of each triangle; none: they are one
    sharp : degrees; 180 for rims and borders only
    """
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkNonMergingPointLocator
    from vtkmodules.vtkFiltersCore import vtkFeatureEdges

    own = triangles + len(nodes) * (0 if part is None else part[:, None].astype(np.int64))
    node, corners = np.unique(own, return_inverse=True)  # parts share no points, so that each has a rim
    node %= len(nodes)
    surface = pyvista.PolyData.from_regular_faces(nodes[node], corners.reshape(-1, 3))
    surface.point_data["node"] = node
    finder = vtkFeatureEdges()  # pyvista's would merge the points of parts where they touch
    finder.SetLocator(vtkNonMergingPointLocator())
    finder.SetInputData(surface)
    finder.SetFeatureAngle(sharp)
    finder.NonManifoldEdgesOff()
    finder.Update()
    found = pyvista.wrap(finder.GetOutput())
    pairs = found["node"][found.lines.reshape(-1, 3)[:, 1:]] if found.n_cells else np.empty((0, 2), int)
    return np.unique(np.sort(pairs, axis=1), axis=0)


def box_edges(points: np.ndarray) -> np.ndarray:
    """(12, 2, 3) edges of the bounding box: an outline for bodies without sharp edges."""
    import pyvista

    box = pyvista.Box(np.stack([points.min(axis=0), points.max(axis=0)], axis=1).ravel()).extract_all_edges()
    return np.asarray(box.points)[box.lines.reshape(-1, 3)[:, 1:]]
