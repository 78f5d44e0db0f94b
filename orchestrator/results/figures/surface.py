"""What one sees of a mesh: outer faces, and the edges worth a line. VTK's filters find them.

The run names what is to be drawn and leaves it to another process: VTK is imported where it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPolyData

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
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import VTK_QUADRATIC_TETRA, VTK_TETRA, vtkUnstructuredGrid
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    grid = vtkUnstructuredGrid()
    grid.SetPoints(_points(nodes))
    grid.SetCells({4: VTK_TETRA, 10: VTK_QUADRATIC_TETRA}[cells.shape[1]], _regular(cells))
    for data, name, count in ((grid.GetPointData(), "node", len(nodes)), (grid.GetCellData(), "cell", len(cells))):
        number = numpy_to_vtkIdTypeArray(np.arange(count, dtype=np.int64), deep=True)
        number.SetName(name)
        data.AddArray(number)
    finder = vtkDataSetSurfaceFilter()
    finder.SetInputData(grid)
    finder.SetNonlinearSubdivisionLevel(1)
    finder.Update()
    found = finder.GetOutput()
    node, cell = (vtk_to_numpy(data.GetArray(name)) for data, name in (
        (found.GetPointData(), "node"), (found.GetCellData(), "cell")))
    return node[_corners(found.GetPolys(), 3)], cell.copy()


def edges(nodes: np.ndarray, triangles: np.ndarray, part: np.ndarray | None = None,
          sharp: float = SHARP) -> np.ndarray:
    """(e, 2) node ids of the edges where faces turn sharply, at borders between parts, and of open rims.

    Parameters
    ----------
    nodes : (n, 3); triangles : (k, 3) int
    part : (k,) int, of each triangle; none: they are one
    sharp : degrees; 180 for rims and borders only
    """
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkNonMergingPointLocator
    from vtkmodules.vtkFiltersCore import vtkFeatureEdges

    own = triangles + len(nodes) * (0 if part is None else part[:, None].astype(np.int64))
    node, corners = np.unique(own, return_inverse=True)  # parts share no points, so that each has a rim
    node %= len(nodes)
    surface = triangulated(nodes[node], corners.reshape(-1, 3))
    number = numpy_to_vtkIdTypeArray(np.ascontiguousarray(node, dtype=np.int64), deep=True)
    number.SetName("node")
    surface.GetPointData().AddArray(number)
    finder = vtkFeatureEdges()
    finder.SetLocator(vtkNonMergingPointLocator())  # points of parts are not merged where they touch
    finder.SetInputData(surface)
    finder.SetFeatureAngle(sharp)
    finder.NonManifoldEdgesOff()
    finder.Update()
    found = finder.GetOutput()
    if not found.GetNumberOfLines():
        return np.empty((0, 2), int)
    pairs = vtk_to_numpy(found.GetPointData().GetArray("node"))[_corners(found.GetLines(), 2)]
    return np.unique(np.sort(pairs, axis=1), axis=0)


def box_edges(points: np.ndarray) -> np.ndarray:
    """(12, 2, 3) edges of the bounding box: an outline for bodies without sharp edges."""
    corner = np.indices((2, 2, 2)).reshape(3, 8).T
    one, other = np.nonzero(np.triu(np.abs(corner[:, None] - corner).sum(axis=2) == 1))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.where(corner[np.column_stack([one, other])], high, low)


def triangulated(points: np.ndarray, triangles: np.ndarray) -> vtkPolyData:
    """VTK's object of points (p, 3) and triangles (k, 3)."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    data = vtkPolyData()
    data.SetPoints(_points(points))
    data.SetPolys(_regular(triangles))
    return data


def segments(ends: np.ndarray) -> vtkPolyData:
    """VTK's object of lines from (e, 2, 3) ends."""
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    data = vtkPolyData()
    data.SetPoints(_points(ends.reshape(-1, 3)))
    data.SetLines(_regular(np.arange(2 * len(ends)).reshape(-1, 2)))
    return data


def _points(points: np.ndarray):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints

    result = vtkPoints()
    result.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=float), deep=True))
    return result


def _regular(cells: np.ndarray):
    """VTK's list of cells (k, n) of n points each."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    result = vtkCellArray()
    result.SetData(cells.shape[1], numpy_to_vtkIdTypeArray(np.ascontiguousarray(cells, dtype=np.int64).ravel(), deep=True))
    return result


def _corners(cells, count: int) -> np.ndarray:
    """(k, count) points of VTK's list of cells that have as many."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(cells.GetConnectivityArray()).reshape(-1, count)
