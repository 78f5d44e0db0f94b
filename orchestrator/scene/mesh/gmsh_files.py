"""gmsh's mesh files, and what gmsh reads: physical groups that hold some elements, elements in two of them."""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import meshio
import numpy as np

from orchestrator.scene.mesh.recognised import HEAD, bad_file, check_content

CHILD = Path(__file__).with_name("gmsh_child.py")
SHOWN = 200  # letters of a complaint of gmsh's


def read_by_gmsh(path: Path) -> meshio.Mesh:
    """What gmsh reads: its groups become physical names, as in its own files.

    gmsh takes what it does not know for a script, and runs the options that it finds beside a file: the content is looked at
    first, and gmsh sees the file in a folder where nothing else is, in a process that can start no other.

    Raises InputError: the content is not what the ending says, or gmsh cannot read it
    """
    check_content(path, ("mesh", "file"))
    with tempfile.TemporaryDirectory(prefix="orchestrator-mesh-") as folder:
        source, target = Path(folder) / f"source{path.suffix.lower()}", Path(folder) / "mesh.msh"
        source.symlink_to(path.resolve())
        done = subprocess.run([sys.executable, "-P", str(CHILD), source.name, target.name], cwd=folder, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, errors="replace", process_group=0)
        if done.returncode or not target.is_file():
            said = done.stdout.strip().splitlines()[-1:] if done.returncode == 1 else []
            reason = said[0].replace(source.name, path.name)[:SHOWN] if said else f"it ended with {done.returncode}"
            raise bad_file(path, f"cannot be read by gmsh: {reason}", "a mesh file that gmsh reads",
                           "check that the ending fits the content, or save it as .msh")
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                return meshio.read(target)
        except (Exception, SystemExit):  # meshio prints its complaint and ends the program
            raise bad_file(path, "cannot be read: gmsh finds no mesh in it", "nodes and elements",
                           "save the mesh again, with its volume elements") from None


def not_saved(raw: meshio.Mesh, path: Path) -> list[str]:
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


def physical(raw: meshio.Mesh) -> list[tuple[str, tuple[int, int]]]:
    """gmsh's physical names, each with its tag and dimension."""
    return [(name, tuple(map(int, np.ravel(value)[:2]))) for name, value in raw.field_data.items() if np.size(value) >= 2]
