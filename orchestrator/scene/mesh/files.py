"""Mesh files: what meshio, gmsh or ``inp`` reads, as long as it holds tets; groups are kept by name.

Of ten-node tets the corners are kept, and edges that bend become straight: said, with how far.
"""

from __future__ import annotations

import io
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.inp import read_inp
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.mesh.size import check_memory
from orchestrator.scene.model import Mesh

# Where the formats keep the number of each cell's group, the most telling first.
TAGS = ("gmsh:physical", "medit:ref", "gmsh:geometrical", "avsucd:material", "flac3d:group", "tetgen:ref",
        "netgen:index")
# Bytes that reading takes per byte of the file, at least.
ROOM = 2.0
BY_GMSH = {".unv", ".med", ".bdf", ".nas"}  # gmsh reads more of these than meshio does
BENT = 1e-6  # of an edge's length, from which its middle is not where a straight one's would be
FLAT_CELLS = {"vertex", "line", "triangle", "quad"}


def file(mesh: Any) -> Mesh:
    """The mesh file named by ``mesh.file``."""
    return read(Path(mesh.file))


def read(path: Path) -> Mesh:
    """Reads tets and named groups; nodes that no tet uses are dropped.

    Volumes are named by gmsh's physical names or the format's cell sets, else ``volume_<tag>``;
    surfaces likewise, else ``surface_<tag>``. A named surface none of whose triangles lies on tets is there, empty.

    Raises
    ------
    InputError : no such file, too large, unreadable, no tets, quadratic tets, other solid elements
    """
    raw, remarks = straightened(_load(path))
    solid = sorted({block.type for block in raw.cells} - FLAT_CELLS - {"line3", "triangle6", "quad8", "quad9"})
    problem = None
    if any(kind.startswith("tetra") and kind not in ("tetra", "tetra10") for kind in solid):
        problem = Problem(("mesh", "file"), f"{path}: tetrahedra of higher order ({', '.join(solid)})",
                          "four- or ten-node tetrahedra", "save the mesh with linear elements (gmsh: -order 1) and write "
                          "blackbox: {element: P2}: the nodes amid the edges are put back here")
    elif "tetra" not in solid and solid:
        problem = Problem(("mesh", "file"), f"{path}: no tetrahedra but {', '.join(solid)}", "four-node tetrahedra",
                          "mesh the volume with tetrahedra (gmsh: without recombination, Mesh.RecombineAll = 0), or split "
                          "each cell in tetrahedra the same way on both sides of its faces")
    elif "tetra" not in solid:
        kinds = ", ".join(sorted({block.type for block in raw.cells})) or "no cells at all"
        problem = Problem(("mesh", "file"), f"{path}: no tetrahedra (it has {kinds})", "four-node tetrahedra",
                          "mesh the volume, not only its surface, and save the volume elements")
    elif len(solid) > 1:
        problem = Problem(("mesh", "file"), f"{path}: solid elements {', '.join(solid)}", "tetrahedra alone",
                          "split the other elements in tetrahedra")
    if problem:
        raise InputError(problem)
    cells, groups, rest = _cells(raw, "tetra", 3, "volume")
    volumes, volume = _volumes(groups, len(cells), rest)
    triangles, surfaces, _ = _cells(raw, "triangle", 2, "surface")
    used, inverse = np.unique(cells, return_inverse=True)
    renumber = np.full(len(raw.points), -1)
    renumber[used] = np.arange(len(used))
    named = {}
    for name, index in surfaces.items():
        rows = renumber[triangles[index]]
        # Triangles away from the tets (shells, helper geometry) are no faces of theirs.
        named[name] = rows[(rows >= 0).all(axis=1)]
    for name, (_, dimension) in _physical(raw):
        if dimension == 2:
            named.setdefault(name, np.empty((0, 3), dtype=np.int64))
    points = np.asarray(raw.points, dtype=float)[used]
    return Mesh(points, inverse.reshape(-1, 4), volume, volumes, named, str(path), remarks=remarks)


def straightened(raw: meshio.Mesh) -> tuple[meshio.Mesh, list[str]]:
    """The mesh with four-node tets and three-node triangles in the place of those with ten and six, and what to say of it."""
    corners, linear = {"tetra10": 4, "triangle6": 3}, {"tetra10": "tetra", "triangle6": "triangle"}
    if not any(block.type in corners for block in raw.cells):
        return raw, []
    said = ["ten-node tetrahedra are read by their corners; blackbox: {element: P2} puts a node on the middle of every edge"]
    tets = [block.data for block in raw.cells if block.type == "tetra10"]
    if tets:
        tets = np.vstack(tets)
        ends = raw.points[tets[:, TET_EDGES]]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        # meshio's, gmsh's and CalculiX's order of the nodes amid the edges is VTK's
        bend = np.linalg.norm(raw.points[tets[:, 4:]] - ends.mean(axis=2), axis=2)
        if (bend > BENT * length).any():
            worst = np.unravel_index(np.argmax(bend / length), bend.shape)
            said.append(f"edges that bend are straight here: their middles are off by up to {bend.max():.3g}, or "
                        f"{bend[worst] / length[worst]:.2g} of an edge; a finer mesh follows the shape better")
    cells = [meshio.CellBlock(linear.get(b.type, b.type), b.data[:, : corners[b.type]] if b.type in corners else b.data)
             for b in raw.cells]
    return meshio.Mesh(raw.points, cells, cell_data=raw.cell_data, cell_sets=raw.cell_sets, field_data=raw.field_data), said


def _load(path: Path) -> meshio.Mesh:
    if not path.is_file():
        raise InputError(Problem(("mesh", "file"), f"{path}: no such file", "an existing mesh file",
                                 "check the path"))
    check_memory(ROOM * path.stat().st_size, ("mesh", "file"), str(path), "use a coarser mesh, or save it in a binary format")
    heard = io.StringIO()
    if path.suffix.lower() == ".inp":
        return read_inp(path)
    if path.suffix.lower() in BY_GMSH:
        return _by_gmsh(path)
    try:
        # meshio prints its complaint and ends the program.
        with redirect_stderr(heard), redirect_stdout(heard):
            return meshio.read(path)
    except (Exception, SystemExit) as error:
        reason = str(error) if not isinstance(error, SystemExit) else " ".join(heard.getvalue().split())
        raise InputError(Problem(("mesh", "file"), f"{path}: cannot be read: {reason or type(error).__name__}",
                                 "a mesh file in a format meshio knows (.msh, .mesh, .vtu, .inp, …)",
                                 "check that the ending fits the content, or convert it with gmsh")) from None


def _by_gmsh(path: Path) -> meshio.Mesh:
    """What gmsh reads: its groups become physical names, as in its own files."""
    import gmsh

    from orchestrator.scene.mesh.gmsh_session import last_complaint, session

    with session(), tempfile.TemporaryDirectory(prefix="orchestrator-mesh-") as folder:
        try:
            gmsh.open(str(path))
        except Exception as error:
            raise InputError(Problem(("mesh", "file"), f"{path}: cannot be read: {last_complaint(error)}", "a mesh file that gmsh reads",
                                     "check that the ending fits the content, or save it as .msh")) from None
        for group in gmsh.model.getPhysicalGroups():
            name = gmsh.model.getPhysicalName(*group)
            if name != name.strip():  # MED's have 80 letters
                gmsh.model.removePhysicalName(name)
                gmsh.model.setPhysicalName(*group, name.strip())
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(Path(folder) / "mesh.msh"))
        with redirect_stdout(io.StringIO()):
            return meshio.read(Path(folder) / "mesh.msh")


def _cells(raw: meshio.Mesh, kind: str, dimension: int, word: str) -> tuple[np.ndarray, dict, str]:
    """All cells of a kind, their groups (name → indices), and a name for those in no group."""
    blocks = [i for i, block in enumerate(raw.cells) if block.type == kind]
    if not blocks:
        return np.empty((0, 3), dtype=int), {}, ""
    sizes = [len(raw.cells[i].data) for i in blocks]
    offsets = np.r_[0, np.cumsum(sizes)]
    cells = np.concatenate([np.asarray(raw.cells[i].data, dtype=np.int64) for i in blocks])
    groups: dict[str, list[np.ndarray]] = {}
    for name, sets in raw.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        index = [offset + np.asarray(sets[i], dtype=np.int64)
                 for i, offset in zip(blocks, offsets) if sets[i] is not None and len(sets[i])]
        if index:
            groups.setdefault(name, []).extend(index)
    known = {numbers: name for name, numbers in _physical(raw)}
    for key in TAGS:
        if key not in raw.cell_data:
            continue
        tags = np.concatenate([np.ravel(raw.cell_data[key][i]).astype(np.int64) for i in blocks])
        for tag in np.unique(tags[tags != 0]):
            name = known.get((int(tag), dimension), f"{word}_{tag}") if key == "gmsh:physical" else f"{word}_{tag}"
            groups.setdefault(name, []).append(np.flatnonzero(tags == tag))
        if tags.any():
            break
    return cells, {name: np.unique(np.concatenate(index)) for name, index in groups.items()}, \
        f"{word}_0" if groups else f"{word}_1"


def _physical(raw: meshio.Mesh) -> list[tuple[str, tuple[int, int]]]:
    """gmsh's physical names, each with its tag and dimension."""
    return [(name, tuple(map(int, np.ravel(value)[:2]))) for name, value in raw.field_data.items() if np.size(value) >= 2]


def _volumes(groups: dict[str, np.ndarray], size: int, rest: str) -> tuple[list[str], np.ndarray]:
    """One volume per cell: the smallest of the groups that hold it, so that sets of sets do not hide parts."""
    volume = np.full(size, -1)
    names = list(groups)
    for i in sorted(range(len(names)), key=lambda i: -len(groups[names[i]])):
        volume[groups[names[i]]] = i
    if (volume < 0).any():
        volume[volume < 0] = len(names)
        names.append(rest)
    used, volume = np.unique(volume, return_inverse=True)
    return [names[i] for i in used], volume
