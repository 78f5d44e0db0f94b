"""VTK's files, .vtu, .pvtu and .vtk, as ParaView, pyvista, meshio and gmsh write them: cells and the names of their groups.

A group's name is a text on each cell, or belongs to a number on each cell: by the texts of a field of the file, or by fields
of two numbers, tag and dimension, that are called as gmsh's physical names are.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.recognised import check_content
from orchestrator.scene.mesh.vtk_sizes import check_room

# VTK's numbers of cell types → meshio's words; of those that are missing the number is told
TYPES = {1: "vertex", 3: "line", 4: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid",
         21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15", 27: "pyramid13",
         28: "quad9", 29: "hexahedron27", 71: "tetra of any order"}
FLAT = {"vertex", "line", "line3", "triangle", "triangle6", "quad", "quad8", "quad9"}
# Those whose nodes are numbered along the axes.
ALONG_AXES = {8: ("quad", [0, 1, 3, 2]), 11: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}
# Cell arrays that say which group a cell is in, the most telling first; case and _ do not matter.
GROUPS = ("physicalname", "gmsh:physical", "physicalids", "physicalid", "medit:ref", "volume", "volumes", "part", "parts", "partid", "group",
          "groups", "groupid", "region", "regionid", "materialid", "materialids", "material", "cellentityids", "gmsh:geometrical",
          "subdomain")


def read_vtk(path: Path) -> meshio.Mesh:
    """The mesh as meshio would have it, groups as cell sets: by their names, else ``volume_<number>`` and ``surface_<number>``.

    Raises InputError: VTK complains; nodes that are not there; text on the cells in more arrays than one
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy

    for piece in _pieces(path) if path.suffix.lower() == ".pvtu" else [path]:
        check_room(piece)
    grid = _grid(path)
    if not grid.GetNumberOfCells():
        raise _problem(path, "no cells", "a grid with tetrahedra")
    points = vtk_to_numpy(grid.GetPoints().GetData()).astype(float)
    ends = vtk_to_numpy(grid.GetCells().GetOffsetsArray()).astype(np.int64)
    nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).astype(np.int64)
    types = vtk_to_numpy(grid.GetCellTypes()).astype(np.int64)
    if len(nodes) and not 0 <= nodes.min() <= nodes.max() < len(points):
        raise _problem(path, f"cells with nodes up to {nodes.max()} of {len(points)}", "the nodes of every cell")
    kinds = np.unique(np.column_stack([types, np.diff(ends)]), axis=0)
    members = [np.flatnonzero((types == kind) & (np.diff(ends) == width)) for kind, width in kinds]
    cells = []
    for (kind, width), index in zip(kinds, members):
        block = nodes[ends[index][:, None] + np.arange(width)]
        word, turn = ALONG_AXES.get(int(kind), (TYPES.get(int(kind), f"cells of VTK's type {kind}"), slice(None)))
        cells.append(meshio.CellBlock(word, block[:, turn]))
    named, numbers = _groups(path, grid)
    physical, nothing = _physical(grid), np.empty(0, dtype=np.int64)
    known = {tuple(pair.tolist()): name for name, pair in physical.items()}
    found: dict[str, list[np.ndarray]] = {}
    for i, (block, index) in enumerate(zip(cells, members)):
        groups = {name: np.flatnonzero(np.isin(index, at)) for name, at in named.items()}
        if numbers is not None:
            word = "volume" if block.type not in FLAT else "surface"
            dimension = 3 if block.type not in FLAT else 2
            groups = {known.get((tag, dimension), f"{word}_{tag}"): np.flatnonzero(numbers[index] == tag)
                      for tag in np.unique(numbers[index]).tolist()}
        for name, at in groups.items():
            found.setdefault(name, [nothing] * len(cells))[i] = at
    return meshio.Mesh(points, cells, cell_sets=found, field_data=physical)


def _pieces(path: Path) -> list[Path]:
    """The files of a .pvtu; raises InputError for one that is not beside it, or below."""
    names = [html.unescape(name.decode(errors="replace")) for name in re.findall(rb"\bSource\s*=\s*[\"']([^\"']*)", path.read_bytes())]
    folder = path.resolve().parent
    for i, name in enumerate(names, 1):
        piece = path.parent / name
        if not piece.resolve().is_relative_to(folder) or piece.suffix.lower() != ".vtu":
            raise _problem(path, f"piece {i} is not beside it", "pieces (.vtu) in its folder or below", "put the pieces beside it, and name them so")
        if not piece.is_file():
            raise _problem(path, f"piece {i} is not there", "all pieces that it names", "save it again, with its pieces")
        check_content(piece, ("mesh", "file"))
    return [path.parent / name for name in names]


def _grid(path: Path) -> Any:
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    if path.suffix.lower() == ".vtk":
        from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader as Reader
    elif path.suffix.lower() == ".pvtu":
        from vtkmodules.vtkIOXML import vtkXMLPUnstructuredGridReader as Reader
    else:
        from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader as Reader
    before, heard = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    level = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(heard)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader = Reader()
        reader.SetFileName(str(path))
        if path.suffix.lower() == ".vtk":
            reader.ReadAllScalarsOn()
            reader.ReadAllFieldsOn()
        reader.Update()
    finally:
        vtkOutputWindow.SetInstance(before)
        vtkLogger.SetStderrVerbosity(level)
    if complaints := heard.GetOutput().strip():  # of a grid half read too
        # "ERROR: In file, line\nvtkReader (0x…): what is wrong"
        first = re.search(r"\(0x\w+\): (.+)", complaints)
        raise _problem(path, f"cannot be read: {first[1] if first else complaints.splitlines()[-1]}", "an unstructured grid as VTK writes it")
    return reader.GetOutput()


def _groups(path: Path, grid: Any) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Cells of each named group, and the numbers of groups (m,) that have none."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = grid.GetCellData()
    arrays = [data.GetAbstractArray(i) for i in range(data.GetNumberOfArrays())]
    arrays = [a for a in arrays if a.GetName() and a.GetNumberOfComponents() == 1]
    texts = sorted((a for a in arrays if a.IsA("vtkStringArray")), key=_rank)
    if texts:
        if len(texts) > 1 and _rank(texts[0]) == len(GROUPS):
            raise _problem(path, "text on the cells in the arrays " + ", ".join(f"'{a.GetName()}'" for a in texts),
                           "one of them that names each cell's volume", f"call that one 'volume' (pyvista: grid.rename_array('{texts[0].GetName()}', 'volume'))")
        return _by_name(np.array([texts[0].GetValue(i) for i in range(texts[0].GetNumberOfValues())])), None
    whole = {a.GetName(): vtk_to_numpy(a) for a in arrays if a.IsA("vtkDataArray")}
    # numbers saved as floats by a program that has no others
    whole = {name: v.astype(np.int64) for name, v in whole.items() if np.isfinite(v).all() and (v == np.round(v)).all()}
    joined = _joined(whole)
    known = sorted((a for a in arrays if a.GetName() in whole and _rank(a) < len(GROUPS)), key=_rank)
    for array in known:
        numbers = whole[array.GetName()]
        if not numbers.any() and len(known) > 1:
            continue
        names = _texts(grid, array.GetName(), numbers)
        if names is None and joined is not None:
            names = {int(tag): str(own[0]) for tag in np.unique(numbers)
                     if len(own := np.unique(joined[(numbers == tag) & (joined != "")])) == 1}
            names = names if len(set(names.values())) == len(np.unique(numbers)) else None
        if names is None:
            return {}, numbers
        return _by_name(np.array([names[n] for n in numbers.tolist()])), None
    return ({}, None) if joined is None else (_by_name(joined), None)


def _by_name(words: np.ndarray) -> dict[str, np.ndarray]:
    words = np.char.strip(words.astype(str))
    return {str(name): np.flatnonzero(words == name) for name in np.unique(words) if name}


def _rank(array: Any) -> int:
    """Place of a cell array among those that tell groups."""
    name = array.GetName().lower().replace("_", "").replace(" ", "")
    return GROUPS.index(name) if name in GROUPS else len(GROUPS)


def _texts(grid: Any, name: str, numbers: np.ndarray) -> dict[int, str] | None:
    """Names of the numbers: a field of texts that is called as the array is, or ``names``; counted from 0, or from 1.

    None where there is none or the numbers leave open which: a wrong name is worse than none.
    """
    fields = grid.GetFieldData()
    for key in (name, f"{name}_names", f"{name} names", "names"):
        array = fields.GetAbstractArray(key)
        if array is None or not array.IsA("vtkStringArray"):
            continue
        words = [array.GetValue(i) for i in range(array.GetNumberOfValues())]
        low, high = int(numbers.min()), int(numbers.max())
        if (low == 0 and high < len(words)) or (low == 1 and high == len(words)):
            return {low + i: word for i, word in enumerate(words)}
    return None


def _joined(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """(m,) name of each cell, of meshio's cell sets: one array, called by all sets, with the place of each cell's set; "": none."""
    for key, numbers in arrays.items():
        words = key.split("-")
        if len(words) > 1 and numbers.min() >= -1 and numbers.max() == len(words) - 1:
            return np.array(["" if word.startswith("gmsh:") else word for word in words] + [""])[numbers]
    return None


def _physical(grid: Any) -> dict[str, np.ndarray]:
    """gmsh's physical names as pyvista keeps them: a field with tag and dimension."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    fields, found = grid.GetFieldData(), {}
    for i in range(fields.GetNumberOfArrays()):
        array = fields.GetAbstractArray(i)
        if array.IsA("vtkDataArray") and array.GetNumberOfValues() == 2 and (pair := vtk_to_numpy(array).ravel())[1] in (1, 2, 3):
            found[array.GetName()] = pair.astype(np.int64)
    return found


def _problem(path: Path, found: str, expected: str, cure: str = "check that the ending fits the content, or save it again as an "
             "unstructured grid (.vtu)") -> InputError:
    return InputError(Problem(("mesh", "file"), f"{path}: {found}", expected, cure))
