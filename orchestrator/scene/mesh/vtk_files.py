"""VTK's files, .vtu, .pvtu and .vtk, as ParaView, pyvista, meshio and gmsh write them: cells and the names of their groups.

A group's name is a text on each cell, or belongs to a number on each cell: by the texts of a field of the file, or by fields
of two numbers, tag and dimension, that are called as gmsh's physical names are.
"""

from __future__ import annotations

import base64
import html
import mmap
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import meshio
import numpy as np

from orchestrator.scene.mesh.size import bad_file, check_content, check_memory

if TYPE_CHECKING:  # it takes a second to import
    import pyvista

# VTK's numbers of cell types → meshio's words; of those that are missing the number is told
TYPES = {1: "vertex", 3: "line", 4: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid",
         21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15", 27: "pyramid13",
         28: "quad9", 29: "hexahedron27", 71: "tetra of any order"}
CURE = "check that the ending fits the content, or save it again as an unstructured grid (.vtu)"
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
    for piece in _pieces(path) if path.suffix.lower() == ".pvtu" else [path]:
        _check_room(piece)
    grid = _grid(path)
    if not grid.n_cells:
        raise bad_file(path, "no cells", "a grid with tetrahedra", CURE)
    points, nodes, types = np.asarray(grid.points, dtype=float), grid.cell_connectivity.astype(np.int64), grid.celltypes.astype(np.int64)
    ends, widths = grid.cell_offsets.astype(np.int64), np.diff(grid.cell_offsets)
    if len(nodes) and not 0 <= nodes.min() <= nodes.max() < len(points):
        raise bad_file(path, f"cells with nodes up to {nodes.max()} of {len(points)}", "the nodes of every cell", CURE)
    named, numbers = _groups(path, grid)
    # gmsh's physical names as pyvista keeps them: fields with tag and dimension
    fields = {name: np.ravel(pair) for name, pair in grid.field_data.items()}
    physical = {name: pair.astype(np.int64) for name, pair in fields.items() if pair.dtype.kind in "iuf" and pair.size == 2 and pair[1] in (1, 2, 3)}
    known = {tuple(pair.tolist()): name for name, pair in physical.items()}
    kinds = np.unique(np.column_stack([types, widths]), axis=0).tolist()
    cells, found = [], {}
    for i, (kind, width) in enumerate(kinds):
        index = np.flatnonzero((types == kind) & (widths == width))
        block = nodes[ends[index][:, None] + np.arange(width)]
        word, turn = ALONG_AXES.get(kind, (TYPES.get(kind, f"cells of VTK's type {kind}"), slice(None)))
        cells.append(meshio.CellBlock(word, block[:, turn]))
        groups = {name: np.flatnonzero(np.isin(index, at)) for name, at in named.items()}
        if numbers is not None:
            what, dimension = ("surface", 2) if word in FLAT else ("volume", 3)
            groups = {known.get((tag, dimension), f"{what}_{tag}"): np.flatnonzero(numbers[index] == tag)
                      for tag in np.unique(numbers[index]).tolist()}
        for name, at in groups.items():
            found.setdefault(name, [np.empty(0, dtype=np.int64)] * len(kinds))[i] = at
    return meshio.Mesh(points, cells, cell_sets=found, field_data=physical)


def _pieces(path: Path) -> list[Path]:
    """The files of a .pvtu; raises InputError for one that is not beside it, or below."""
    names = [html.unescape(name.decode(errors="replace")) for name in re.findall(rb"\bSource\s*=\s*[\"']([^\"']*)", path.read_bytes())]
    folder = path.resolve().parent
    for i, name in enumerate(names, 1):
        piece = path.parent / name
        if not piece.resolve().is_relative_to(folder) or piece.suffix.lower() != ".vtu":
            raise bad_file(path, f"piece {i} is not beside it", "pieces (.vtu) in its folder or below", "put the pieces beside it, and name them so")
        if not piece.is_file():
            raise bad_file(path, f"piece {i} is not there", "all pieces that it names", "save it again, with its pieces")
        check_content(piece, ("mesh", "file"))
    return [path.parent / name for name in names]


def _grid(path: Path) -> pyvista.UnstructuredGrid:
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLPUnstructuredGridReader, vtkXMLUnstructuredGridReader

    before, heard = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    level = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(heard)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader = {".vtk": vtkUnstructuredGridReader, ".pvtu": vtkXMLPUnstructuredGridReader}.get(path.suffix.lower(), vtkXMLUnstructuredGridReader)()
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
        raise bad_file(path, f"cannot be read: {first[1] if first else complaints.splitlines()[-1]}", "an unstructured grid as VTK writes it", CURE)
    return pyvista.wrap(reader.GetOutput())


def _groups(path: Path, grid: pyvista.UnstructuredGrid) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Cells of each named group, and the numbers of groups (m,) that have none."""
    arrays = {name: np.asarray(grid.cell_data[name]) for name in sorted(grid.cell_data, key=_rank) if np.ndim(grid.cell_data[name]) == 1}
    texts = [name for name, values in arrays.items() if values.dtype.kind == "U"]
    if texts:
        if len(texts) > 1 and _rank(texts[0]) == len(GROUPS):
            raise bad_file(path, "text on the cells in the arrays " + ", ".join(f"'{name}'" for name in texts), "one of them that names each "
                           "cell's volume", f"call that one 'volume' (pyvista: grid.rename_array('{texts[0]}', 'volume'))")
        return _by_name(arrays[texts[0]]), None
    # numbers saved as floats by a program that has no others
    whole = {name: v.astype(np.int64) for name, v in arrays.items() if np.isfinite(v).all() and (v == np.round(v)).all()}
    joined = _joined(whole)
    known = [name for name in whole if _rank(name) < len(GROUPS)]
    for name in known:
        numbers = whole[name]
        if not numbers.any() and len(known) > 1:
            continue
        names = _texts(grid, name, numbers)
        if names is None and joined is not None:
            names = {int(tag): str(own[0]) for tag in np.unique(numbers) if len(own := np.unique(joined[(numbers == tag) & (joined != "")])) == 1}
            names = names if len(set(names.values())) == len(np.unique(numbers)) else None
        return ({}, numbers) if names is None else (_by_name(np.array([names[n] for n in numbers.tolist()])), None)
    return ({}, None) if joined is None else (_by_name(joined), None)


def _by_name(words: np.ndarray) -> dict[str, np.ndarray]:
    words = np.char.strip(words)
    return {str(name): np.flatnonzero(words == name) for name in np.unique(words) if name}


def _rank(name: str) -> int:
    """Place of a cell array among those that tell groups."""
    name = name.lower().replace("_", "").replace(" ", "")
    return GROUPS.index(name) if name in GROUPS else len(GROUPS)


def _texts(grid: pyvista.UnstructuredGrid, name: str, numbers: np.ndarray) -> dict[int, str] | None:
    """Names of the numbers: a field of texts that is called as the array is, or ``names``; counted from 0, or from 1.

    None where there is none or the numbers leave open which: a wrong name is worse than none.
    """
    low, high = int(numbers.min()), int(numbers.max())
    for key in (name, f"{name}_names", f"{name} names", "names"):
        words = np.ravel(grid.field_data[key]) if key in grid.field_data else np.empty(0)
        if words.dtype.kind == "U" and ((low == 0 and high < len(words)) or (low == 1 and high == len(words))):
            return {low + i: str(word) for i, word in enumerate(words)}
    return None


def _joined(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """(m,) name of each cell, of meshio's cell sets: one array, called by all sets, with the place of each cell's set; "": none."""
    for key, numbers in arrays.items():
        words = key.split("-")
        if len(words) > 1 and numbers.min() >= -1 and numbers.max() == len(words) - 1:
            return np.array(["" if word.startswith("gmsh:") else word for word in words] + [""])[numbers]
    return None


# Sizes that files declare are asked before VTK takes memory for them: it would end this program where there is none. A compressed array
# begins with words of 4 or 8 bytes: the number of blocks, their size, that of the last one, what each takes in the file. One that is
# not compressed begins with its size, which cannot be more than the file has.
# points and cells, in XML and in the older format
_SIZES = re.compile(rb"(?:NumberOf|\n)(Points|Cells|POINTS|CELLS)(?:\s*=\s*[\"']|[ \t]+)(\d{1,30})")
_HEAD = 1 << 12  # bytes in which the first element of the XML stands
_ARRAY = re.compile(rb"<(?:Data)?Array\b([^>]*)>\s*")
_APPENDED = re.compile(rb"<AppendedData\b([^>]*)>\s*_")


def _check_room(path: Path) -> None:
    """Raises InputError where the sizes that a file declares do not fit in memory, or in the file."""
    if path.stat().st_size == 0:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        wanted = sum(int(n) * (24 if kind in (b"Points", b"POINTS") else 9) for kind, n in _SIZES.findall(text))
        head = re.search(rb"<VTKFile\b[^>]*>", text[:_HEAD])
        if head:
            order = "big" if _attribute(head[0], "byte_order") == b"BigEndian" else "little"
            width, compressed = 8 if _attribute(head[0], "header_type") == b"UInt64" else 4, _attribute(head[0], "compressor") is not None
            for start, coded in _arrays(text):
                words = _words(text, start, coded, width, 3 if compressed else 1, order)
                blocks, size, last = words if len(words) == 3 else (0, 0, 0)
                if (blocks * width if compressed else sum(words)) > len(text):
                    raise bad_file(path, f"the array at byte {start} declares more than the file has",
                                   "an unstructured grid as VTK writes it", "check the file: is it whole? save it again")
                wanted += blocks * size + last
    check_memory(wanted, ("mesh", "file"), f"{path}, by the sizes that it declares", "check the file: are these its true sizes?")


def _attribute(element: bytes, name: str) -> bytes | None:
    found = re.search(rb"\b%s\s*=\s*[\"']\s*([^\"'\s]*)" % name.encode(), element)
    return found[1] if found else None


def _arrays(text: mmap.mmap) -> Iterator[tuple[int, bool]]:
    """Where binary arrays begin, and whether they are in base64."""
    appended = _APPENDED.search(text)
    for found in _ARRAY.finditer(text, 0, appended.start() if appended else len(text)):
        kind, offset = _attribute(found[1], "format"), _attribute(found[1], "offset") or b""
        if kind == b"binary":
            yield found.end(), True
        elif kind == b"appended" and appended and offset.isdigit():
            yield appended.end() + int(offset), _attribute(appended[1], "encoding") == b"base64"


def _words(text: mmap.mmap, start: int, coded: bool, width: int, count: int, order: str) -> list[int]:
    """The first words of an array; fewer where the text ends, or is no base64."""
    raw = text[start : start + (4 * -(-width * count // 3) if coded else width * count)]
    if coded:
        try:
            raw = base64.b64decode(raw)
        except ValueError:  # VTK complains
            return []
    return [int.from_bytes(raw[i : i + width], order) for i in range(0, min(len(raw) // width, count) * width, width)]  # type: ignore[arg-type]
