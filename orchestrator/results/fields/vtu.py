"""VTK's files for unstructured grids (.vtu)."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

_TYPES = {3: "triangle", 4: "tetra", 10: "tetra10"}  # by nodes of a cell


def write_vtu(path: str | os.PathLike[str], points: np.ndarray, cells: np.ndarray, point_data: Mapping[str, np.ndarray],
              cell_data: Mapping[str, np.ndarray]) -> None:
    """Writes one grid.

    Parameters
    ----------
    points : (n, 3) float
    cells : (m, 3, 4 or 10) int: triangles, tets or ten-node tets
    point_data, cell_data : name → (n,) or (n, components), (m,) or (m, components)

    Raises
    ------
    OSError
    """
    import meshio  # not before there is something to write

    grid = meshio.Mesh(points, [(_TYPES[cells.shape[1]], cells)], point_data=dict(point_data),
                       cell_data={name: [values] for name, values in cell_data.items()})
    meshio.vtu.write(path, grid, binary=True, compression=None)
