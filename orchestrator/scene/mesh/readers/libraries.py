"""Formats that libraries read: meshio those that it knows, gmsh its own and some of which it reads
more than meshio does.

gmsh takes what it does not know for a script, and runs the options that it finds beside a file: the
content is looked at first, and gmsh sees the file in a folder where nothing else is, in a process
that can start no other.
"""

from __future__ import annotations

import io
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import meshio
import numpy as np

from orchestrator.optional import check_there
from orchestrator.scene.mesh.checks import bad_file, check_content, HEAD, memory_left
from orchestrator.scene.mesh.readers.child import apart


def quietly(path: Path) -> meshio.Mesh:
    """Return what meshio reads, which prints its complaint and ends the program: that is raised."""
    with redirect_stderr(heard := io.StringIO()), redirect_stdout(heard):
        return meshio.read(path)


def read_by_meshio(path: Path) -> meshio.Mesh:
    """Return the mesh of a file.

    Raises InputError: the content is not what the ending says, or meshio cannot read it
    """
    check_content(path, ("mesh", "file"))
    try:
        return quietly(path)
    except (Exception, SystemExit):
        # what meshio says may quote the file, which may be another's behind a link
        raise bad_file(
            path, "cannot be read: damaged, or of no format that meshio knows by "
                  f"{path.suffix or 'no ending'}",
            "a mesh file in a format meshio knows (.msh, .mesh, .vtu, .inp, …)",
            "check that the ending fits the content, or convert it with gmsh") from None


def read_xdmf(path: Path) -> meshio.Mesh:
    """Return the mesh of an XDMF file.

    Raises InputError: as ``read_by_meshio``; it takes its numbers from a file that is not beside
        it, or below: from a device, say
    """
    check_content(path, ("mesh", "file"))
    for item in re.findall(rb"<DataItem\b[^>]*\bFormat\s*=\s*[\"'](?:HDF|Binary)[\"'][^>]*>([^<]*)",
                           path.read_bytes()):
        named = path.parent / item.decode(errors="replace").strip().partition(":")[0]
        if not named.resolve().is_relative_to(path.resolve().parent) or not named.is_file():
            raise bad_file(path, "it takes numbers from a file that is not beside it",
                           "files in its folder or below",
                           "put them beside it, and name them so")
    return read_by_meshio(path)


def refuse_collection(path: Path) -> meshio.Mesh:
    """Raise InputError: a file that names others."""
    raise bad_file(
        path, "a collection of grids", "one grid (.vtu)",
        "put its blocks together (ParaView: Merge Blocks; pyvista: combine(merge_points=True)) "
        "with a cell array 'volume' that tells them apart, or name each one's file under parts:")


# Numbers of nodes up to so many times their count, and so many more, cost little.
FAR, FEW = 10, 1_000_000


def read_msh(path: Path) -> meshio.Mesh:
    """Return the mesh of a .msh file: by meshio, or by gmsh where that takes much memory or cannot
    read it, as files with groups for some of their elements only."""
    try:
        far = far_apart(path)
    except (ValueError, IndexError):  # damaged, or of another program
        far = False
    try:
        found = read_by_gmsh(path) if far else _own(path)  # ANSYS's begins otherwise
    except (Exception, SystemExit):
        if far:
            raise
        found = read_by_gmsh(path)
    found.info = {"remarks": _not_saved(found, path)}
    return found


def _own(path: Path) -> meshio.Mesh:
    """Return what meshio reads of gmsh's own format, all groups with their names."""
    found = quietly(path)
    found.field_data = named_groups(path)
    return found


def read_by_gmsh(path: Path) -> meshio.Mesh:
    """Return the mesh that gmsh reads: its groups become physical names, as in its own files.

    Raises InputError: the content is not what the ending says, or gmsh cannot read it
    """
    ending = path.suffix.lower()
    if ending in (".bdf", ".nas"):
        check_content(path, ("mesh", "file"))
        _check_cards(path)
    # gmsh passes over names in 2467, written as in 2477
    content = re.sub(rb"(?m)^(\s*-1\s*\n\s*)2467(\s*)$", rb"\g<1>2477\2",
                     path.read_bytes()) if ending == ".unv" else None
    with by_gmsh(path, "mesh.msh", "a mesh file that gmsh reads",
                 "check that the ending fits the content, or save it as .msh", content) as made:
        try:
            return _own(made)
        except (Exception, SystemExit):
            raise bad_file(path, "cannot be read: gmsh finds no mesh in it", "nodes and elements",
                           "save the mesh again, with its volume elements") from None


@contextmanager
def by_gmsh(path: Path, target: str, expected: str, cure: str,
            content: bytes | None = None) -> Iterator[Path]:
    """Give what gmsh makes of a file, in a process apart, see ``child``.

    target : name of the file that it writes; content : to read in place of the file's
    Raises InputError: gmsh cannot read it, with what is expected, and the cure
    """
    check_there("gmsh")
    check_content(path, ("mesh", "file"))
    with tempfile.TemporaryDirectory(prefix="orchestrator-mesh-") as folder:
        source, made = Path(folder) / f"source{path.suffix.lower()}", Path(folder) / target
        if content is None:
            source.symlink_to(path.resolve())
        else:
            source.write_bytes(content)
        if complaint := apart(memory_left(), source, made, folder):
            complaint = complaint.replace(source.name, path.name)
            raise bad_file(path, f"cannot be read by gmsh: {complaint}", expected, cure)
        yield made


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
    if "gmsh:geometrical" not in raw.cell_data or not raw.field_data:
        return []
    with path.open("rb") as file:
        head = file.read(HEAD)
    version, _, rest = head.partition(b"$MeshFormat\n")[2].partition(b"\n")
    found = rest.partition(b"$Entities\n")[2]
    if not version.startswith(b"4.1") or not found:
        return []
    try:
        counts = np.frombuffer(found[:32],
                               dtype=np.uint64) if version.split()[1] == b"1" else found.partition(
                                   b"\n")[0].split()
        known = int(counts[3])
    except (ValueError, IndexError):
        return []
    tags = [np.ravel(values) for block, values in zip(raw.cells, raw.cell_data["gmsh:geometrical"])
            if block.dim == 3]
    if not tags:
        return []
    missing = known - len(np.unique(np.concatenate(tags)))
    return [] if missing <= 0 else [
        f"{missing} of the {known} volumes of gmsh's model have no elements in the file: gmsh "
        "saves only what is in a physical group. If they belong to the model, give each a physical "
        "group, or write the file with Mesh.SaveAll = 1"]


def named_groups(path: Path) -> dict[str, np.ndarray]:
    """Return (k, 2) tags and dimensions of each physical name of a gmsh file: meshio keeps the
    last dimension of a name alone."""
    found: dict[str, list[list[int]]] = {}
    with path.open("rb") as file:
        for line in file:
            if line.startswith((b"$Nodes", b"$Elements", b"$Entities", b"$EndPhysicalNames")):
                break
            if group := re.match(rb'\s*(\d+)\s+(\d+)\s+"(.*)"', line):
                name = group[3].decode(errors="replace")
                found.setdefault(name, []).append([int(group[2]), int(group[1])])
    return {name: np.array(pairs) for name, pairs in found.items()}


def far_apart(path: Path) -> bool:
    """Return whether the largest number of a node in a gmsh file is far beyond their count:
    meshio keeps an array as long as that."""
    with path.open("rb") as file:
        head, _, rest = file.read().partition(b"$Nodes")
    version, kind = (re.search(rb"\$MeshFormat\s+(\S+)\s+(\d)", head)
                     or re.match(b"()()", b"")).groups()
    rest = rest[rest.find(b"\n") + 1 :]
    if version == b"4.1":
        counts = np.frombuffer(rest[:32], np.uint64) if kind == b"1" else rest.split(None, 4)[:4]
        _, count, _, largest = map(int, counts)
        return bool(largest > FAR * count + FEW)
    if not version.startswith(b"2"):
        return False
    line, _, table = rest.partition(b"\n")
    count = int(line)
    if kind == b"1":
        numbers = np.frombuffer(table, np.dtype([("id", "i4"), ("x", "f8", 3)]), count)["id"]
    else:
        numbers = np.array(table.split(None, 4 * count)[: 4 * count : 4], dtype=np.int64)
    return bool(numbers.max(initial=0) > FAR * count + FEW)
