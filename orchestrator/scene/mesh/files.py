"""Mesh files: what meshio, gmsh, VTK or ``inp`` reads, as long as it holds solid cells; groups are kept by name.

Of quadratic cells the corners are kept, and edges that bend become straight: said, with how far.
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
from orchestrator.scene.mesh.splitting import in_tets
from orchestrator.scene.mesh.vtk_files import read_vtk
from orchestrator.scene.model import Mesh

# Where the formats keep the number of each cell's group, the most telling first.
TAGS = ("gmsh:physical", "medit:ref", "gmsh:geometrical", "avsucd:material", "flac3d:group", "tetgen:ref",
        "netgen:index")
BY_VTK = {".vtu", ".pvtu", ".vtk"}  # meshio knows no text and no fields of theirs
# Cells with nodes amid their edges: the linear ones that they are read as, and their corners.
CORNERS = {"tetra10": ("tetra", 4), "triangle6": ("triangle", 3), "quad8": ("quad", 4), "quad9": ("quad", 4),
           "hexahedron20": ("hexahedron", 8), "hexahedron27": ("hexahedron", 8), "wedge15": ("wedge", 6), "wedge18": ("wedge", 6),
           "pyramid13": ("pyramid", 5), "pyramid14": ("pyramid", 5)}
# Ends of the edges behind the nodes that follow the corners, in VTK's order, which is meshio's and CalculiX's.
_RING = [[0, 1], [1, 2], [2, 3], [3, 0]]
_HEX = np.array([*_RING, [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_WEDGE = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])
_PYRAMID = np.array([*_RING, [0, 4], [1, 4], [2, 4], [3, 4]])
EDGES = {"tetra10": TET_EDGES, "hexahedron20": _HEX, "hexahedron27": _HEX, "wedge15": _WEDGE, "wedge18": _WEDGE,
         "pyramid13": _PYRAMID, "pyramid14": _PYRAMID}
# Bytes that reading takes per byte of the file, at least.
ROOM = 2.0
BY_GMSH = {".unv", ".med", ".bdf", ".nas"}  # gmsh reads more of these than meshio does
HEAD = 1 << 16  # bytes at the start of a file that hold gmsh's format, names and counts
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
    raw, split = in_tets(raw, str(path))
    solid = sorted({block.type for block in raw.cells} - FLAT_CELLS - {"line3"})
    problem = None
    if any(kind.startswith("tetra") and kind != "tetra" for kind in solid):
        problem = Problem(("mesh", "file"), f"{path}: tetrahedra of higher order ({', '.join(solid)})",
                          "four- or ten-node tetrahedra", "save the mesh with linear elements (gmsh: -order 1) and write "
                          "blackbox: {element: P2}: the nodes amid the edges are put back here")
    elif "tetra" not in solid and not solid:
        kinds = ", ".join(sorted({block.type for block in raw.cells})) or "no cells at all"
        problem = Problem(("mesh", "file"), f"{path}: no tetrahedra (it has {kinds})", "four-node tetrahedra",
                          "mesh the volume, not only its surface, and save the volume elements")
    elif solid != ["tetra"]:
        problem = Problem(("mesh", "file"), f"{path}: cells that are not known here: {', '.join(kind for kind in solid if kind != 'tetra')}",
                          "tetrahedra, hexahedra, prisms or pyramids, linear or quadratic", "mesh the volume with tetrahedra")
    if problem:
        raise InputError(problem)
    cells, groups, rest = _cells(raw, "tetra", 3, "volume")
    volumes, volume, unclear = _volumes(groups, len(cells), rest)
    if lost := [name for name, (_, dimension) in _physical(raw) if dimension == 3 and name not in groups]:
        unclear.append("named in the file, with no elements: " + ", ".join(f"'{name}'" for name in lost[:5])
                       + (", …" if len(lost) > 5 else "") + "; gmsh's version 2.2 with Mesh.SaveAll = 1 forgets the groups, 4.1 keeps them")
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
    return Mesh(points, inverse.reshape(-1, 4), volume, volumes, named, str(path), remarks=[*remarks, *split, *unclear, *_not_saved(raw, path)])


def straightened(raw: meshio.Mesh) -> tuple[meshio.Mesh, list[str]]:
    """The mesh with linear cells in the place of quadratic ones, and what to say of it."""
    if not any(block.type in CORNERS for block in raw.cells):
        return raw, []
    said = ["ten-node tetrahedra are read by their corners; blackbox: {element: P2} puts a node on the middle of every edge"]
    if not any(block.type == "tetra10" for block in raw.cells):
        said = [said[0].replace("ten-node tetrahedra", "quadratic cells")]
    worst, off = 0.0, 0.0
    for block in raw.cells:
        if block.type not in EDGES:
            continue
        ends = raw.points[block.data[:, EDGES[block.type]]]
        first = CORNERS[block.type][1]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        bend = np.linalg.norm(raw.points[block.data[:, first : first + ends.shape[1]]] - ends.mean(axis=2), axis=2)
        if (bend > BENT * length).any():
            worst = max(worst, float(np.max(bend / length)))
            off = max(off, float(bend.max()))
    if worst:
        said.append(f"edges that bend are straight here: their middles are off by up to {off:.3g}, or {worst:.2g} of an edge; "
                    "a finer mesh follows the shape better")
    cells = [meshio.CellBlock(CORNERS[b.type][0], b.data[:, : CORNERS[b.type][1]]) if b.type in CORNERS else b for b in raw.cells]
    return meshio.Mesh(raw.points, cells, cell_data=raw.cell_data, cell_sets=raw.cell_sets, field_data=raw.field_data), said


def _load(path: Path) -> meshio.Mesh:
    if not path.is_file():
        raise InputError(Problem(("mesh", "file"), f"{path}: no such file", "an existing mesh file",
                                 "check the path"))
    check_memory(ROOM * path.stat().st_size, ("mesh", "file"), str(path), "use a coarser mesh, or save it in a binary format")
    if path.suffix.lower() in (".vtm", ".vtmb", ".pvd"):
        raise InputError(Problem(("mesh", "file"), f"{path}: a collection of grids", "one grid (.vtu)",
                                 "put its blocks together (ParaView: Merge Blocks; pyvista: combine(merge_points=True)) with a cell array "
                                 "'volume' that tells them apart, or name each one's file under parts:"))
    heard = io.StringIO()
    if path.suffix.lower() == ".inp":
        return read_inp(path)
    if path.suffix.lower() in BY_GMSH:
        return _by_gmsh(path)
    if path.suffix.lower() in BY_VTK:
        return read_vtk(path)
    try:
        # meshio prints its complaint and ends the program.
        with redirect_stderr(heard), redirect_stdout(heard):
            raw = meshio.read(path)
        return once(raw) if path.suffix.lower() == ".msh" else raw
    except (Exception, SystemExit) as error:
        if path.suffix.lower() == ".msh":  # meshio knows no file with groups for some of its elements only
            return _by_gmsh(path)
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
        gmsh.option.setNumber("Mesh.SaveAll", 0 if _all_in_groups() else 1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(Path(folder) / "mesh.msh"))
        with redirect_stdout(io.StringIO()):
            return meshio.read(Path(folder) / "mesh.msh")


def _all_in_groups() -> bool:
    """Puts gmsh's volumes that are in no physical group in groups, if anything is in one: without, meshio reads no such file."""
    import gmsh

    groups = gmsh.model.getPhysicalGroups()
    if not groups:
        return False
    held = [tag for d, number in groups if d == 3 for tag in gmsh.model.getEntitiesForPhysicalGroup(3, number)]
    free = [tag for _, tag in gmsh.model.getEntities(3) if tag not in held]
    for tags, name in [(free, "volume_0")] if held and free else [([tag], f"volume_{tag}") for tag in free]:
        number = gmsh.model.addPhysicalGroup(3, tags)
        if old := gmsh.model.getPhysicalName(3, number):  # of a group that is no more
            gmsh.model.removePhysicalName(old)
        gmsh.model.setPhysicalName(3, number, name)
    return True


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


def once(raw: meshio.Mesh) -> meshio.Mesh:
    """Every element once: gmsh's older files (2.2) have an element in two physical groups twice, once for each."""
    if not {"gmsh:physical", "gmsh:geometrical"} <= raw.cell_data.keys():
        return raw
    cells, names, twice = [], [], False
    known = {numbers: name for name, numbers in _physical(raw)}
    for kind in dict.fromkeys(block.type for block in raw.cells):
        blocks = [i for i, block in enumerate(raw.cells) if block.type == kind]
        data = np.concatenate([raw.cells[i].data for i in blocks])
        group, entity = (np.concatenate([np.ravel(raw.cell_data[key][i]) for i in blocks]).astype(np.int64)
                         for key in ("gmsh:physical", "gmsh:geometrical"))
        pairs = np.unique(np.column_stack([entity, group]), axis=0)
        back = np.arange(len(data))
        if len(pairs) > len(np.unique(entity)):  # of an entity: else there is nothing to look for
            _, first, back = np.unique(np.sort(data, axis=1), axis=0, return_index=True, return_inverse=True)
            twice, data, back = twice or len(first) < len(data), data[first], back.ravel()
        flat = raw.cells[blocks[0]].dim < 3
        cells.append(meshio.CellBlock(kind, data))
        names.append({known.get((int(tag), raw.cells[blocks[0]].dim), f"{'surface' if flat else 'volume'}_{tag}"): np.unique(back[group == tag])
                      for tag in np.unique(group[group != 0])})
    if not twice:
        return raw
    sets = {name: [own.get(name, np.empty(0, dtype=np.int64)) for own in names] for name in dict.fromkeys(n for own in names for n in own)}
    return meshio.Mesh(raw.points, cells, cell_sets=sets, field_data=raw.field_data)


def _not_saved(raw: meshio.Mesh, path: Path) -> list[str]:
    """What to say of volumes that gmsh (4.1) knew and did not save."""
    if path.suffix.lower() != ".msh" or "gmsh:geometrical" not in raw.cell_data or not raw.field_data:
        return []
    with path.open("rb") as file:
        head = file.read(HEAD)
    version, _, rest = head.partition(b"$MeshFormat\n")[2].partition(b"\n")
    found = rest.partition(b"$Entities\n")[2]
    if not version.startswith(b"4.1") or not found:
        return []
    try:
        counts = np.frombuffer(found[:32], dtype=np.uint64) if version.split()[1] == b"1" else found.partition(b"\n")[0].split()
        known = int(counts[3])
    except (ValueError, IndexError):
        return []
    tags = [np.ravel(values) for block, values in zip(raw.cells, raw.cell_data["gmsh:geometrical"]) if block.type == "tetra"]
    missing = known - len(np.unique(np.concatenate(tags)))
    return [] if missing <= 0 else [
        f"{missing} of the {known} volumes of gmsh's model have no elements in the file: gmsh saves only what is in a physical group. If they "
        "belong to the model, give each a physical group, or write the file with Mesh.SaveAll = 1"]


def _volumes(groups: dict[str, np.ndarray], size: int, rest: str) -> tuple[list[str], np.ndarray, list[str]]:
    """One volume per cell: the smallest of the groups that hold it, so that sets of sets do not hide parts; what to say of it."""
    volume = np.full(size, -1)
    names, said = list(groups), []
    for i in sorted(range(len(names)), key=lambda i: -len(groups[names[i]])):
        volume[groups[names[i]]] = i
    shared = []
    for i, name in enumerate(names):
        owners, counts = np.unique(volume[groups[name]], return_counts=True)
        lost = [j for j in owners if j != i]
        # Two names for the same tets are no riddle.
        if lost and not (len(owners) == 1 and len(groups[names[lost[0]]]) == len(groups[name])):
            kept = len(groups[name]) - counts[owners != i].sum()
            shared.append(f"of '{name}' {kept:,} of {len(groups[name]):,} are left, the others are in "
                          + ", ".join(f"'{names[j]}'" for j in lost[:3]) + (", …" if len(lost) > 3 else ""))
    if shared:
        said.append("tetrahedra in several groups belong to the smallest of them: " + "; ".join(shared[:5])
                    + (f"; and so on for {len(shared) - 5} more" if len(shared) > 5 else "")
                    + ". A group that keeps none names no volume: name those that have its tetrahedra")
    if (volume < 0).any():
        if groups:
            said.append(f"{(volume < 0).sum():,} of {size:,} tetrahedra are in no group of the file: they are '{rest}'")
        volume[volume < 0] = len(names)
        names.append(rest)
    used, volume = np.unique(volume, return_inverse=True)
    return [names[i] for i in used], volume, said
