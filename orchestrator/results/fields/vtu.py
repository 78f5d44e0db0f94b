"""VTK's files: unstructured grids (.vtu), in pieces (.pvtu), and collections of them over the load steps (.pvd)."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.results.folder import ResultsFolder

_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_TYPES = {3: "triangle", 4: "tetra", 10: "tetra10"}  # by nodes of a cell


def write_vtu(folder: ResultsFolder, name: str, points: np.ndarray, cells: np.ndarray,
              point_data: Mapping[str, np.ndarray], cell_data: Mapping[str, np.ndarray]) -> None:
    """Writes one grid.

    Parameters
    ----------
    name : of the file in the folder
    points : (n, 3) float
    cells : (m, 3, 4 or 10) int: triangles, tets or ten-node tets
    point_data, cell_data : name → (n,) or (n, components), (m,) or (m, components)

    Raises
    ------
    InputError : disk full or folder not writable
    """
    import meshio  # not before there is something to write

    grid = meshio.Mesh(points, [(_TYPES[cells.shape[1]], cells)], point_data=dict(point_data),
                       cell_data={name: [values] for name, values in cell_data.items()})
    with folder.replacing(name) as temporary:
        meshio.vtu.write(temporary, grid, binary=True, compression=None)


def write_pvtu(folder: ResultsFolder, name: str, pieces: Sequence[str], point_data: Mapping[str, np.ndarray],
               cell_data: Mapping[str, np.ndarray]) -> None:
    """Writes what puts the pieces of one grid together, files beside it.

    Parameters
    ----------
    point_data, cell_data : as for ``write_vtu``, of any one cell

    Raises
    ------
    InputError : disk full or folder not writable
    """
    def array(name: str, values: np.ndarray) -> str:
        kind = ("Int" if values.dtype.kind == "i" else "Float") + str(8 * values.dtype.itemsize)
        return (f'      <PDataArray type="{kind}" Name="{name}" '
                f'NumberOfComponents="{1 if values.ndim == 1 else values.shape[1]}"/>')

    rows = ['<?xml version="1.0"?>', f'<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="{_ORDER}">',
            '  <PUnstructuredGrid GhostLevel="0">', "    <PPoints>", array("Points", np.zeros((1, 3))), "    </PPoints>",
            "    <PPointData>", *(array(*item) for item in point_data.items()), "    </PPointData>",
            "    <PCellData>", *(array(*item) for item in cell_data.items()), "    </PCellData>",
            *(f'    <Piece Source="{piece}"/>' for piece in pieces), "  </PUnstructuredGrid>", "</VTKFile>", ""]
    folder.write(name, "\n".join(rows))


def write_pvd(folder: ResultsFolder, name: str, steps: Sequence[str], parts: Sequence[Sequence[str]] = ()) -> None:
    """Writes a ParaView collection of one file per load step beside it, time = step from 1.

    Parameters
    ----------
    parts : of further parts, one file per load step each

    Raises
    ------
    InputError : disk full or folder not writable
    """
    rows = [f'    <DataSet timestep="{step}" group="" part="{part}" file="{file}"/>'
            for part, files in enumerate([steps, *parts]) for step, file in enumerate(files, 1)]
    folder.write(name, "\n".join(['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>",
                                  *rows, "  </Collection>", "</VTKFile>", ""]))
