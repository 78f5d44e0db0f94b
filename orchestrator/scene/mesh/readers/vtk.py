"""VTK's files, .vtu and .vtk, as ParaView, pyvista, meshio and gmsh write them: cells and the names
of their groups.

A group's name is a text on each cell, or belongs to a number on each cell: by the texts of a field
of the file, or by fields of two numbers, tag and dimension, that are called as gmsh's physical
names are.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import meshio
import numpy as np

from orchestrator.optional import check_there
from orchestrator.scene.mesh.checks import bad_file, check_content, memory_left
from orchestrator.scene.mesh.readers.child import apart

# VTK's numbers of cell types → meshio's words; of those that are missing the number is told
TYPES = {1: "vertex", 3: "line", 4: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron",
         13: "wedge", 14: "pyramid",
         21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20",
         26: "wedge15", 27: "pyramid13",
         28: "quad9", 29: "hexahedron27", 71: "tetra of any order"}
CURE = "check that the ending fits the content, or save it again as an unstructured grid (.vtu)"
FLAT = {"vertex", "line", "line3", "triangle", "triangle6", "quad", "quad8", "quad9"}
# Those whose nodes are numbered along the axes.
ALONG_AXES = {8: ("quad", [0, 1, 3, 2]), 11: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}
# Cell arrays that say which group a cell is in, the most telling first; case and _ do not matter.
GROUPS = ("physicalname", "gmsh:physical", "physicalids", "physicalid", "medit:ref", "volume",
          "volumes", "part", "parts", "partid",
          "group",
          "groups", "groupid", "region", "regionid", "materialid", "materialids", "material",
          "cellentityids", "gmsh:geometrical",
          "subdomain")


def read_vtk(path: Path) -> meshio.Mesh:
    """The mesh as meshio would have it, groups as cell sets: by their names, else
    ``volume_<number>`` and ``surface_<number>``.

    Raises InputError: VTK complains; nodes that are not there; text on the cells in more arrays
    than one
    """
    grid, cell, field = _read(path)
    if "types" not in grid:
        raise bad_file(path, "no cells", "a grid with tetrahedra", CURE)
    points, nodes, ends, types = grid["points"].astype(float), *(
        grid[key].astype(np.int64) for key in ("nodes", "ends", "types"))
    widths = np.diff(ends)
    if len(nodes) and not 0 <= nodes.min() <= nodes.max() < len(points):
        raise bad_file(path, f"cells with nodes up to {nodes.max()} of {len(points)}",
                       "the nodes of every cell", CURE)
    named, numbers = _groups(path, cell, field)
    # gmsh's physical names as pyvista keeps them: fields with tag and dimension
    physical = {name: pair.astype(np.int64) for name, pair in field.items()
                if pair.dtype.kind in "iuf" and pair.size == 2
                and pair[1] in (1, 2, 3)}
    known = {tuple(pair.tolist()): name for name, pair in physical.items()}
    kinds = np.unique(np.column_stack([types, widths]), axis=0).tolist()
    cells, found = [], {}
    for i, (kind, width) in enumerate(kinds):
        index = np.flatnonzero((types == kind) & (widths == width))
        block = nodes[ends[index][:, None] + np.arange(width)]
        word, turn = ALONG_AXES.get(kind,
                                    (TYPES.get(kind, f"cells of VTK's type {kind}"), slice(None)))
        cells.append(meshio.CellBlock(word, block[:, turn]))
        groups = {name: np.flatnonzero(np.isin(index, at)) for name, at in named.items()}
        if numbers is not None:
            what, dimension = ("surface", 2) if word in FLAT else ("volume", 3)
            groups = {
                known.get((tag, dimension), f"{what}_{tag}"): np.flatnonzero(numbers[index] == tag)
                      for tag in np.unique(numbers[index]).tolist()}
        for name, at in groups.items():
            found.setdefault(name, [np.empty(0, dtype=np.int64)] * len(kinds))[i] = at
    return meshio.Mesh(points, cells, cell_sets=found, field_data=physical)


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Points and cells as VTK has them, arrays of the cells, arrays of the file."""
    check_there("vtkmodules")
    check_content(path, ("mesh", "file"))
    with tempfile.TemporaryDirectory(prefix="orchestrator-mesh-") as folder:
        target, left = Path(folder) / "grid.npz", memory_left()
        if complaint := apart(left, path.absolute(), target, folder):
            raise bad_file(path, f"cannot be read: {complaint}",
                           "an unstructured grid as VTK writes it, which with all that it declares "
                           f"fits in the {left / 1e9:.2g} GB of memory that are free", CURE)
        with np.load(target) as found:
            return dict(found), *({str(name): found[f"{what}_{i}"]
                                   for i, name in enumerate(found[f"{what}_names"])}
                                  for what in ("cell", "field"))


def _groups(path: Path, cell: dict[str, np.ndarray],
            field: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Cells of each named group, and the numbers of groups (m,) that have none."""
    arrays = {name: cell[name] for name in sorted(cell, key=_rank)}
    texts = [name for name, values in arrays.items() if values.dtype.kind == "U"]
    if texts:
        if len(texts) > 1 and _rank(texts[0]) == len(GROUPS):
            raise bad_file(path, "text on the cells in the arrays "
                           + ", ".join(f"'{name}'" for name in texts),
                           "one of them that names each cell's volume",
                           f"call that one 'volume' (pyvista: grid.rename_array('{texts[0]}', "
                           "'volume'))")
        return _by_name(arrays[texts[0]]), None
    # numbers saved as floats by a program that has no others
    whole = {name: v.astype(np.int64) for name, v in arrays.items() if np.isfinite(v).all()
             and (v == np.round(v)).all()}
    joined = _joined(whole)
    known = [name for name in whole if _rank(name) < len(GROUPS)]
    for name in known:
        numbers = whole[name]
        if not numbers.any() and len(known) > 1:
            continue
        names = _texts(field, name, numbers)
        if names is None and joined is not None:
            names = {int(tag): str(own[0]) for tag in np.unique(numbers)
                     if len(own := np.unique(joined[(numbers == tag) & (joined != "")])) == 1}
            names = names if len(set(names.values())) == len(np.unique(numbers)) else None
        return ({},
                numbers) if names is None else (
                    _by_name(np.array([names[n] for n in numbers.tolist()])), None)
    return ({}, None) if joined is None else (_by_name(joined), None)


def _by_name(words: np.ndarray) -> dict[str, np.ndarray]:
    words = np.char.strip(words)
    return {str(name): np.flatnonzero(words == name) for name in np.unique(words) if name}


def _rank(name: str) -> int:
    """Place of a cell array among those that tell groups."""
    name = name.lower().replace("_", "").replace(" ", "")
    return GROUPS.index(name) if name in GROUPS else len(GROUPS)


def _texts(field: dict[str, np.ndarray], name: str, numbers: np.ndarray) -> dict[int, str] | None:
    """Names of the numbers: a field of texts that is called as the array is, or ``names``; counted
    from 0, or from 1.

    None where there is none or the numbers leave open which: a wrong name is worse than none.
    """
    low, high = int(numbers.min()), int(numbers.max())
    for key in (name, f"{name}_names", f"{name} names", "names"):
        words = field.get(key, np.empty(0))
        if words.dtype.kind == "U" and ((low == 0 and high < len(words))
                                        or (low == 1 and high == len(words))):
            return {low + i: str(word) for i, word in enumerate(words)}
    return None


def _joined(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """(m,) name of each cell, of meshio's cell sets: one array, called by all sets, with the place
    of each cell's set; "": none.
    """
    for key, numbers in arrays.items():
        words = key.split("-")
        if len(words) > 1 and numbers.min() >= -1 and numbers.max() == len(words) - 1:
            return np.array(["" if word.startswith("gmsh:") else word for word in words]
                            + [""])[numbers]
    return None
