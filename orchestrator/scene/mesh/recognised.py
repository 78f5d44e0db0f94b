"""What a file is by its content: the ending says what it should be, and no reader gets anything else.

gmsh takes whatever it does not know for a script, and runs it; other readers quote what they do not understand.
"""

from __future__ import annotations

import re
from pathlib import Path

from orchestrator.errors import InputError, KeyPath, Problem

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
    ".pvtu": (_VTK % b"PUnstructuredGrid", "<VTKFile type=\"PUnstructuredGrid\">"),
    ".vtk": (rb"# vtk DataFile Version", "# vtk DataFile Version"),
    ".xdmf": (_XDMF, "<Xdmf"), ".xmf": (_XDMF, "<Xdmf"), ".xml": (_XML + rb"<dolfin\b", "<dolfin"),
    ".mesh": (_MEDIT, "Medit's MeshVersionFormatted"),
    ".step": (_STEP, "ISO-10303-21;"), ".stp": (_STEP, "ISO-10303-21;"),
    ".brep": (rb"\s*(DBRep_DrawableShape|CASCADE Topology|Open CASCADE Topology)", "DBRep_DrawableShape or CASCADE Topology"),
}


def check_content(path: Path, key: KeyPath, source: str = "") -> None:
    """Raises InputError for a file whose content is not what its ending says, as far as the ending is known here.

    key : of the YAML that names it
    source : what the user calls the file, for the message; none: its path
    """
    start = _KNOWN.get(path.suffix.lower())
    if start is None:
        return
    with path.open("rb") as file:
        known = re.match(start[0], file.read(HEAD), re.DOTALL)
    if not known:
        raise InputError(Problem(key, f"{source or path}: its content is not what {path.suffix} stands for",
                                 f"a file that begins with {start[1]}",
                                 "check that the ending fits the content, and save it again from the program that made it"))


def bad_file(path: Path | str, found: str, expected: str, cure: str) -> InputError:
    """What to raise of a mesh file."""
    return InputError(Problem(("mesh", "file"), f"{path}: {found}", expected, cure))
