"""Mesh files: what meshio, gmsh, VTK or ``inp`` reads, as long as it holds solid cells; groups are kept by name.

Of quadratic cells the corners are kept, and edges that bend become straight: said, with how far.
"""

from __future__ import annotations

import io
import re
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from orchestrator.optional import check_there
from orchestrator.scene.mesh.child import apart
from orchestrator.scene.mesh.groups import cells_of, far_apart, named_groups, physical_names, volumes_of
from orchestrator.scene.mesh.inp import read_inp
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.checks import HEAD, bad_file, check_content, check_memory, memory_left
from orchestrator.scene.mesh.partitioned import in_partitions, read_all
from orchestrator.scene.mesh.splitting import in_tets, straightened
from orchestrator.scene.mesh.vtk_files import read_vtk

ROOM = 2.0  # bytes that reading takes per byte of the file, at least
BY_VTK = {".vtu", ".vtk"}  # meshio knows no text and no fields of theirs
BY_GMSH = {".unv", ".med", ".bdf", ".nas"}  # gmsh reads more of these than meshio does
FLAT_CELLS = {"vertex", "line", "line3", "triangle", "quad"}


def file(mesh: Any) -> Mesh:
    """The mesh file named by ``mesh.file``."""
    return read(Path(mesh.file))


def read(path: Path) -> Mesh:
    """Reads tets and named groups; nodes that no tet uses are dropped.

    Volumes are named by gmsh's physical names or the format's cell sets, else ``volume_<tag>``;
    surfaces likewise, else ``surface_<tag>``. A named surface none of whose triangles lies on tets is there, empty.
    Raises InputError: no such file, too large, unreadable, no solid cells, of higher order, too distorted to be split
    """
    loaded = _load(path)
    raw, remarks = straightened(loaded)
    raw, split = in_tets(raw, str(path))
    _check_kinds(path, {block.type for block in raw.cells})
    cells, groups, rest = cells_of(raw, "tetra", 3, "volume")
    volumes, volume, unclear = volumes_of(groups, len(cells), rest)
    if lost := [name for name, (_, dimension) in physical_names(raw) if dimension == 3 and name not in groups]:
        unclear.append("named in the file, with no elements: " + ", ".join(f"'{name}'" for name in lost[:5])
                       + (", …" if len(lost) > 5 else "") + "; gmsh's version 2.2 with Mesh.SaveAll = 1 forgets the groups, 4.1 keeps them")
    triangles, surfaces, _ = cells_of(raw, "triangle", 2, "surface")
    used, inverse = np.unique(cells, return_inverse=True)
    renumber = np.full(len(raw.points), -1)
    renumber[used] = np.arange(len(used))
    named = {name: renumber[triangles[index]] for name, index in surfaces.items()}
    # Triangles away from the tets (shells, helper geometry) are no faces of theirs.
    named = {name: rows[(rows >= 0).all(axis=1)] for name, rows in named.items()}
    for name, (_, dimension) in physical_names(raw):
        if dimension == 2:
            named.setdefault(name, np.empty((0, 3), dtype=np.int64))
    return Mesh(np.asarray(raw.points, dtype=float)[used], inverse.reshape(-1, 4), volume, volumes, named, str(path), remarks=[
        *(loaded.info or {}).get("remarks", []), *remarks, *split, *unclear, *_not_saved(raw, path)])


def _check_kinds(path: Path, kinds: set[str]) -> None:
    """Raises InputError where solid cells are not tets, all of them, or there are none."""
    solid = sorted(kinds - FLAT_CELLS)
    if any(kind.startswith("tetra") and kind != "tetra" for kind in solid):
        problem = (f"tetrahedra of higher order ({', '.join(solid)})", "four- or ten-node tetrahedra",
                   "save the mesh with linear elements (gmsh: "
                   "-order 1) and write blackbox: {element: P2}: the nodes amid the edges are put back here")
    elif not solid:
        problem = (f"no tetrahedra (it has {', '.join(sorted(kinds)) or 'no cells at all'})", "four-node tetrahedra",
                   "mesh the volume, not only its surface, and save the volume elements")
    elif solid != ["tetra"]:
        problem = (f"cells that are not known here: {', '.join(kind for kind in solid if kind != 'tetra')}",
                   "tetrahedra, hexahedra, prisms or pyramids, linear or quadratic", "mesh the volume with tetrahedra")
    else:
        return
    raise bad_file(path, *problem)


def _load(path: Path) -> meshio.Mesh:
    """Read a file with the reader of its ending."""
    ending = path.suffix.lower()
    if parts := in_partitions(path):
        check_memory(ROOM * sum(path.stat().st_size for path in parts), ("mesh", "file"), str(parts[0]), "use a coarser mesh")
        return read_all(parts)
    if not path.is_file():
        raise bad_file(path, "no such file", "an existing mesh file", "check the path")
    check_memory(ROOM * path.stat().st_size, ("mesh", "file"), str(path), "use a coarser mesh, or save it in a binary format")
    if ending in (".vtm", ".vtmb", ".pvd", ".pvtu"):
        raise bad_file(path, "a collection of grids", "one grid (.vtu)",
                       "put its blocks together (ParaView: Merge Blocks; pyvista: combine(merge_points=True)) with a cell array "
                       "'volume' that tells them apart, or name each one's file under parts:")
    if ending == ".inp":
        return read_inp(path)
    if ending in BY_GMSH or ending == ".msh" and _far_apart(path):
        return _read_by_gmsh(path)
    if ending != ".msh":  # that of ANSYS begins otherwise, and meshio knows it
        check_content(path, ("mesh", "file"))
    if ending in BY_VTK:
        return read_vtk(path)
    if ending in (".xdmf", ".xmf"):
        _check_beside(path)
    try:
        with redirect_stderr(heard := io.StringIO()), redirect_stdout(heard):  # meshio prints its complaint and ends the program
            found = meshio.read(path)
        if ending == ".msh":
            found.field_data = named_groups(path)
        return found
    except (Exception, SystemExit):
        if ending == ".msh":  # meshio knows no file with groups for some of its elements only
            return _read_by_gmsh(path)
        # what meshio says may quote the file, which may be another's behind a link
        raise bad_file(path, f"cannot be read: damaged, or of no format that meshio knows by {path.suffix or 'no ending'}",
                       "a mesh file in a format meshio knows (.msh, .mesh, .vtu, .inp, …)",
                       "check that the ending fits the content, or convert it with gmsh") from None


def _far_apart(path: Path) -> bool:
    """As ``groups.far_apart``; False of a file that its reader will find damaged, or of another program."""
    try:
        return far_apart(path)
    except (ValueError, IndexError):
        return False


def _check_beside(path: Path) -> None:
    """Raises InputError where a file of XDMF takes its numbers from one that is not beside it, or below: from a device, say."""
    for item in re.findall(rb"<DataItem\b[^>]*\bFormat\s*=\s*[\"'](?:HDF|Binary)[\"'][^>]*>([^<]*)", path.read_bytes()):
        named = path.parent / item.decode(errors="replace").strip().partition(":")[0]
        if not named.resolve().is_relative_to(path.resolve().parent) or not named.is_file():
            raise bad_file(path, "it takes numbers from a file that is not beside it", "files in its folder or below",
                           "put them beside it, and name them so")


def _read_by_gmsh(path: Path) -> meshio.Mesh:
    """Read with gmsh: its groups become physical names, as in its own files.

    gmsh takes what it does not know for a script, and runs the options that it finds beside a file: the content is looked at
    first, and gmsh sees the file in a folder where nothing else is, in a process that can start no other.

    Raises InputError: the content is not what the ending says, or gmsh cannot read it
    """
    check_there("gmsh")
    check_content(path, ("mesh", "file"))
    if path.suffix.lower() in (".bdf", ".nas"):
        _check_cards(path)
    with tempfile.TemporaryDirectory(prefix="orchestrator-mesh-") as folder:
        source, target = Path(folder) / f"source{path.suffix.lower()}", Path(folder) / "mesh.msh"
        if path.suffix.lower() == ".unv":  # gmsh passes over names in 2467, written as in 2477
            source.write_bytes(re.sub(rb"(?m)^(\s*-1\s*\n\s*)2467(\s*)$", rb"\g<1>2477\2",
                                      path.read_bytes()))
        else:
            source.symlink_to(path.resolve())
        if complaint := apart(memory_left(), source, target, folder):
            raise bad_file(path, f"cannot be read by gmsh: {complaint.replace(source.name, path.name)}", "a mesh file that gmsh reads",
                           "check that the ending fits the content, or save it as .msh")
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                found = meshio.read(target)
            found.field_data = named_groups(target)
        except (Exception, SystemExit):  # meshio prints its complaint and ends the program
            raise bad_file(path, "cannot be read: gmsh finds no mesh in it", "nodes and elements",
                           "save the mesh again, with its volume elements") from None
    return found


def _check_cards(path: Path) -> None:
    """Raise InputError for Nastran's cards that gmsh passes over though nodes hang on them:
    coordinate systems, files included."""
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        card = re.match(r"(GRID|GRDSET|INCLUDE)\b(\*?)", line, re.IGNORECASE)
        if card is None:
            continue
        wide = 16 if card[2] else 8
        system = line[8 + wide : 8 + 2 * wide] if "," not in line else (
            line.split("$")[0].split(",") + ["", ""])[2]
        if card[1].upper() == "INCLUDE":
            raise bad_file(f"{path}:{number}", "a file included, which is not read",
                           "all cards in one file", "put it in the place of INCLUDE")
        if system.strip() not in ("", "0"):
            found = f"a {card[1].upper()} card with coordinates in system {system.strip()[:8]}"
            raise bad_file(f"{path}:{number}", found, "nodes in the basic system (CP blank or 0)",
                           "have the pre-processor write nodes in the basic system, or save the "
                           "mesh as .msh or .unv")


def _not_saved(raw: meshio.Mesh, path: Path) -> list[str]:
    """Sentence on volumes that gmsh (4.1) knew and did not save."""
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
        f"{missing} of the {known} volumes of gmsh's model have no elements in the file: gmsh saves only what is in a physical group. If "
        "they belong to the model, give each a physical group, or write the file with Mesh.SaveAll = 1"]
