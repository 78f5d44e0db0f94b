"""Checks before a mesh is read or made: a file's content is what its ending says, and there is
memory for the mesh.

gmsh takes whatever it does not know for a script, and runs it; other readers quote what they do not
understand. A slip in h or a count must not take the machine's memory.
"""

from __future__ import annotations

import re
import resource
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from orchestrator.errors import InputError, KeyPath, wrong
from orchestrator.optional import Late
from orchestrator.scene.mesh.faces import MAX_NODES

psutil = Late("psutil")
HEAD = 1 << 16  # bytes that tell
_XML = rb"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*"  # without entities of its own
_VTK = _XML + rb"<VTKFile\b[^>]*\btype\s*=\s*[\"']%s[\"']"
_XDMF = _XML + rb"(<!DOCTYPE\s+Xdmf[^\[>]*(\[\s*\])?\s*>\s*)?(<!--.*?-->\s*)*<Xdmf\b"
_STEP, _MEDIT = rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;", rb"(\s*#[^\n]*\n)*\s*MeshVersionFormatted"
_CARD = rb"(?i)(.*\n)?[ \t]*(GRID|BEGIN BULK|CORD2R|CTETRA|CHEXA|CPENTA|CPYRAM)\b"
# ending → how its content begins, and that in words
_KNOWN = {
    ".msh": (rb"\$(MeshFormat|NOD|Comments)\b", "gmsh's $MeshFormat"),
    ".unv": (rb"\s*-1\s*\n", "-1, a universal file's delimiter"),
    ".med": (rb"\x89HDF\r\n\x1a\n", "HDF5's signature"),
    ".bdf": (_CARD, "Nastran's cards, BEGIN BULK or GRID"),
    ".nas": (_CARD, "Nastran's cards, BEGIN BULK or GRID"),
    ".vtu": (_VTK % b"UnstructuredGrid", "<VTKFile type=\"UnstructuredGrid\">"),
    ".vtk": (rb"# vtk DataFile Version", "# vtk DataFile Version"),
    ".xdmf": (_XDMF, "<Xdmf"), ".xmf": (_XDMF, "<Xdmf"), ".xml": (_XML + rb"<dolfin\b", "<dolfin"),
    ".mesh": (_MEDIT, "Medit's MeshVersionFormatted"),
    ".step": (_STEP, "ISO-10303-21;"), ".stp": (_STEP, "ISO-10303-21;"),
    ".brep": (rb"\s*(DBRep_DrawableShape|CASCADE Topology|Open CASCADE Topology)",
              "DBRep_DrawableShape or CASCADE Topology"),
}


def check_content(path: Path, key: KeyPath, source: str = "") -> None:
    """Raises InputError for a file whose content is not what its ending says, as far as the ending
    is known here.

    key : of the YAML that names it
    source : what the user calls the file, for the message; none: its path
    """
    start = _KNOWN.get(path.suffix.lower())
    if start is None:
        return
    with path.open("rb") as file:
        known = re.match(start[0], file.read(HEAD), re.DOTALL)
    if not known:
        raise wrong(key, f"{source or path}: its content is not what {path.suffix} stands for",
                    f"a file that begins with {start[1]}",
                    "check that the ending fits the content, and save it again from the program "
                    "that made it")


def check_complete(path: Path, key: KeyPath, source: str) -> None:
    """Raises InputError for a BREP file whose end is missing: OpenCASCADE reads on for ever, or
    ends the program.

    Every shape ends with a star, and the file with the shape that holds them all.
    """
    if path.suffix.lower() != ".brep":
        return
    count, shapes = re.search(rb"(?:\nTShapes (\d+)\s*\n(.*))?$", path.read_bytes(),
                              re.DOTALL).groups(b"0")
    found = len(re.findall(rb"\*\s", shapes))
    if found < int(count) or not re.search(rb"\*\s*[+-]\d+ \d+\s*$", shapes):
        raise wrong(key, f"{source}: its end is missing, after {found} whole shapes",
                    "a BREP file as a program writes it",
                    "copy or export the model again")


def bad_file(path: Path | str, found: str, expected: str, cure: str) -> InputError:
    """The error to raise of a mesh file."""
    return wrong(("mesh", "file"), f"{path}: {found}", expected, cure)


DENSITY = 0.82  # nodes per h³, measured
# per node, that a mesh of tets and its faces take at most while they are made, measured
BYTES = 2200.0
_GROUPS = Path("/sys/fs/cgroup")


def check_size(nodes: float, path: KeyPath, found: str, cure: Callable[[float], str]) -> None:
    """Raises InputError for a mesh of more nodes (estimated) than there may be, with what would do.

    path : the key that decides on it; found : what stands there; cure : factor that elements have
        to grow by → what to write
    """
    fit = memory_left() / BYTES
    if not nodes <= (most := min(fit, MAX_NODES)):
        expected = f"at most {MAX_NODES} nodes" if fit >= MAX_NODES else \
            f"at most {fit:.2g} nodes, in the {BYTES * fit / 1e9:.2g} GB of memory that are free"
        raise wrong(path, f"{found} makes about {nodes:.2g} nodes", expected,
                    cure(1.05 * (nodes / most) ** (1 / 3)))


def coarser(h: float) -> Callable[[float], str]:
    """The cure of an element size that is too small."""
    return lambda factor: f"take h: {h * factor:.2g} or more"


def check_memory(needed: float, path: KeyPath, found: str, cure: str) -> None:
    """Raises InputError for what takes more bytes than are free, with both numbers."""
    if not needed <= (left := memory_left()):
        raise wrong(path, f"{found}: takes about {needed / 1e9:.2g} GB of memory",
                    f"at most the {left / 1e9:.2g} GB that are free", cure)


def memory_left() -> float:
    """Bytes that this process can still take: free on the machine, in its group of processes, below
    its own limit.
    """
    left = [float(psutil.virtual_memory().available)]
    for most, used in (("memory.max", "memory.current"),
                       # of containers
                       ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")):
        with suppress(OSError, ValueError):
            left.append(float((_GROUPS / most).read_text()) - float((_GROUPS / used).read_text()))
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    if soft != resource.RLIM_INFINITY:
        left.append(float(soft - psutil.Process().memory_info().vms))
    return max(min(left), 0.0)
