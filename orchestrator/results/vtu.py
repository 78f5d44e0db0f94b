"""VTK's files for unstructured grids (.vtu), their arrays raw behind the XML.

meshio, which writes them as text in base64, takes several times as long.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np

# numbers in VTK's CellType, by nodes of a cell
_TYPES = {3: 5, 4: 10, 10: 24}
_HEADER = np.dtype(np.uint64)


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
    count, size = cells.shape
    arrays: list[np.ndarray] = []
    rows = ['<?xml version="1.0"?>',
            f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{sys.byteorder.capitalize()}Endian" '
            'header_type="UInt64">',
            f'<UnstructuredGrid><Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">']
    for section, data in (
            ("Points", {"Points": points}),
            ("Cells", {"connectivity": cells.ravel(), "offsets": size * np.arange(1, count + 1),
                       "types": np.full(count, _TYPES[size], np.uint8)}),
            ("PointData", point_data), ("CellData", cell_data)):
        rows.append(f"<{section}>")
        for name, values in data.items():
            offset = sum(_HEADER.itemsize + array.nbytes for array in arrays)
            arrays.append(np.ascontiguousarray(values))
            rows.append(_row(name, arrays[-1], offset))
        rows.append(f"</{section}>")
    rows.append('</Piece></UnstructuredGrid>\n<AppendedData encoding="raw">\n_')
    with open(path, "wb") as file:
        file.write("\n".join(rows).encode())
        for array in arrays:
            file.write(_HEADER.type(array.nbytes).tobytes())
            file.write(array.data)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def _row(name: str, values: np.ndarray, offset: int) -> str:
    """How an array is declared."""
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{components} format="appended" offset="{offset}"/>'
