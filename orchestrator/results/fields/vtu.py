"""VTK's files: unstructured grids (.vtu), in pieces (.pvtu), and collections of them over the load steps (.pvd).

Numbers are appended to a grid's file as they are in memory, which takes a fifth of the time that text takes (base64), and
three quarters of the room.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.results.folder import ResultsFolder

_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_TYPES = {3: 5, 4: 10, 10: 24}  # VTK's, by nodes of a cell
_COUNT = np.dtype(np.uint64)  # of an array's bytes, ahead of them


def write_vtu(folder: ResultsFolder, name: str, points: np.ndarray, cells: np.ndarray,
              point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray]) -> None:
    """Writes one grid.

    name : of the file in the folder
    points : (n, 3) float
    cells : (m, 3, 4 or 10) int: triangles, tets or ten-node tets
    point_data, cell_data : name → (n,) or (n, components), (m,) or (m, components)
    """
    appended, at = [], 0

    def array(name: str, values: np.ndarray) -> str:
        nonlocal at
        appended.append(np.ascontiguousarray(values))
        place, at = at, at + _COUNT.itemsize + appended[-1].nbytes
        return f'        <DataArray {_kind(name, values)} format="appended" offset="{place}"/>'

    m, width = cells.shape
    rows = ['<?xml version="1.0"?>', f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{_ORDER}" header_type="UInt64">',
            "  <UnstructuredGrid>", f'    <Piece NumberOfPoints="{len(points)}" NumberOfCells="{m}">',
            "      <Points>", array("Points", points.astype(float, copy=False)), "      </Points>",
            "      <Cells>", array("connectivity", cells.astype(np.int64, copy=False).ravel()),
            array("offsets", np.arange(width, width * m + 1, width)), array("types", np.full(m, _TYPES[width], np.uint8)),
            "      </Cells>", "      <PointData>", *(array(*item) for item in point_data.items()), "      </PointData>",
            "      <CellData>", *(array(*item) for item in cell_data.items()), "      </CellData>",
            "    </Piece>", "  </UnstructuredGrid>", '  <AppendedData encoding="raw">', "_"]
    with folder.replacing(name) as temporary, open(temporary, "wb") as file:
        file.write("\n".join(rows).encode())
        for values in appended:
            file.write(_COUNT.type(values.nbytes))
            file.write(values.data.cast("B") if values.size else b"")
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _kind(name: str, values: np.ndarray) -> str:
    """What is said of an array's numbers."""
    kind = {"i": "Int", "u": "UInt", "f": "Float"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
    return f'type="{kind}" Name="{name}"' + (f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else "")


def write_pvtu(folder: ResultsFolder, name: str, pieces: Sequence[str], point_data: Mapping[str, np.ndarray],
               cell_data: Mapping[str, np.ndarray]) -> None:
    """Writes what puts the pieces of one grid together, files beside it.

    point_data, cell_data : as for ``write_vtu``, of any one cell
    """
    def array(name: str, values: np.ndarray) -> str:
        return f"      <PDataArray {_kind(name, values)}/>"

    rows = ['<?xml version="1.0"?>', f'<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="{_ORDER}">',
            '  <PUnstructuredGrid GhostLevel="0">', "    <PPoints>", array("Points", np.zeros((1, 3))), "    </PPoints>",
            "    <PPointData>", *(array(*item) for item in point_data.items()), "    </PPointData>",
            "    <PCellData>", *(array(*item) for item in cell_data.items()), "    </PCellData>",
            *(f'    <Piece Source="{piece}"/>' for piece in pieces), "  </PUnstructuredGrid>", "</VTKFile>", ""]
    folder.write(name, "\n".join(rows))


def write_pvd(folder: ResultsFolder, name: str, steps: Sequence[str], parts: Sequence[Sequence[str]] = ()) -> None:
    """Writes a ParaView collection of one file per load step beside it, time = step from 1.

    parts : of further parts, one file per load step each
    """
    rows = [f'    <DataSet timestep="{step}" group="" part="{part}" file="{file}"/>'
            for part, files in enumerate([steps, *parts]) for step, file in enumerate(files, 1)]
    folder.write(name, "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>",
                                  *rows, "  </Collection>", "</VTKFile>", ""]))
