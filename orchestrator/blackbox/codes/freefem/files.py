"""FreeFEM's files: meshes, and a form of the user's in its language as the matter of subdomains.

A mesh is medit's ``.meshb`` (version 2), which it reads fastest, of tets and their regions alone:
clamped dofs travel by number, in the message that loads the model. A form is a file of macros and
functions: ``Stiffness(u, v)``, and ``Loads(v)`` if it has loads of its own. The server's scripts
stand around it; what it may use is in ``form_names.idp``, what it is judged by in ``form.idp``.
"""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from orchestrator.blackbox.protocol import Model
from orchestrator.errors import InputError, wrong

FORM_SERVER = "form_server.edp"
_BEFORE, _AFTER = ("elasticity.idp", "form_names.idp"), ("form.idp", "serve.idp")
_REFUSALS = "form_refused.idp"  # between the form and what uses its macros
_GIVEN = {"Stiffness", "Loads"}  # names that a form is there to define
_DEFINED = re.compile(
    r"^[ \t]*(?:macro|func|NewMacro|real|int|bool|matrix|fespace|mesh3|string)(?:\s*\[[^\]]*\])*[ "
    r"\t]+(\w+)",
                      re.MULTILINE)
_WORD = re.compile(r"[A-Za-z]\w*")
# FreeFEM's words where a form uses one of ``_REFUSALS``
_REFUSED = re.compile(r"Identifier refused(\w+) does not exist")
_COMPLAINS = re.compile(r"rror|does not exist")


def script(name: str) -> Path:
    """Path of a FreeFEM script: in ``freefem_scripts/`` beside the package in a clone, inside it in
    a wheel; it may not be there.
    """
    package = Path(str(files("orchestrator")))
    clone = package.parent / "freefem_scripts"
    return (clone if clone.is_dir() else package / "freefem_scripts") / name


def form_server(form: Path) -> str:
    """The script of a server whose matter is the form's."""
    parts = [*map(script, _BEFORE), form.absolute(), *map(script, (_REFUSALS, *_AFTER))]
    return 'load "bfstream"\n' + "".join(f'include "{file}"\n' for file in parts)


def check_form(form: Path) -> None:
    """Raises InputError where the form is not there, lacks its macro, or takes names that the
    server uses.
    """
    try:
        text = form.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise _problem(f"{form}: {error.strerror}", "a file with a macro Stiffness(u, v)",
                       "check the path") from error
    bare = _bare(text)
    names = {match[1]: bare[: match.start(1)].count("\n") + 1 for match in _DEFINED.finditer(bare)}
    if "Stiffness" not in names:
        raise _problem(f"{form} without a macro Stiffness",
                       "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV1)(...) // EOM",
                       "define it: u#x is the x component of u, mine are the regions of your "
                       "matter")
    used = set().union(
        *(_WORD.findall(re.sub(r"//[^\n]*", "", script(name).read_text(encoding="utf-8")))
                         for name in (*_BEFORE, *_AFTER))) - _GIVEN
    for name, line in names.items():
        if name in used:
            raise _problem(
                f"{form}:{line}: a name of the form's, {name}, that the server's script uses too",
                           "names of its own", f"call it my{name[0].upper()}{name[1:]}, say")


def refused_term(form: Path, said: str) -> InputError | None:
    """The error to raise where FreeFEM's last lines say that the form has a term which is refused;
    None where they do not.
    """
    if (match := _REFUSED.search(said)) is None:
        return None
    name = match[1]
    try:
        text = _bare(form.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        text = ""
    place = re.search(rf"\b{name}\b", text)  # else in a file that it includes
    where = (
        f"{form}:{text[: place.start()].count(chr(10)) + 1}" if place
        else f"{form}, in a file that it includes")
    faces = (
        "terms on volumes, int3d(Th, mine, ...): the meshes have no labelled faces, and it would ")
    told = {"on": (faces + "hold nothing", "leave it out: supports are entries of boundary"),
            "jump": (
                "terms of each tet by itself, int3d(Th, mine, ...): what lies beyond a face may "
                "be another subdomain", "leave it out")}
    return _problem(f"{where}: {name}(...) in Stiffness or Loads", *told.get(name, (
        faces + "vanish",
        "leave it out: pressures and tractions are entries of boundary, a skin is a thin volume of "
        "the mesh, a bedding a part beneath")))


def not_compiled(form: Path, said: str, meaning: str) -> InputError:
    """The error to raise where FreeFEM ends before its first word; its own are quoted."""
    words = [line.strip() for line in said.splitlines() if line.strip()]
    first = next((i for i, line in enumerate(words) if _COMPLAINS.search(line)),
                 max(len(words) - 3, 0))
    return _problem(f"{form}: {meaning}; FreeFEM says: {' / '.join(words[first : first + 3])}",
                    "a form that FreeFEM compiles",
                    "mend the line; where it is not in the form, a name that Stiffness or Loads "
                    "uses is missing")


def _bare(text: str) -> str:
    """A script without its comments, line by line."""
    return re.sub(r"//[^\n]*", "",
                  re.sub(r"/\*.*?\*/", lambda m: "\n" * m[0].count("\n"), text, flags=re.DOTALL))


def with_volumes(model: Model) -> Model:
    """The model with the mesh's volumes as regions, of moduli zero, and after them the matters of
    its soles.
    """
    if model.origin is None:  # soles alone
        first, region = 1, 1 + model.region
    else:
        volume = model.origin.arrays(len(model.nodes), len(model.cells))["volume"]
        first = len(model.origin.volumes)
        region = np.where(volume >= 0, volume, first + model.region)
    return replace(model, region=region,
                   materials=np.vstack([np.zeros((first, 2)), model.materials]))


def _problem(found: str, expected: str, cure: str) -> InputError:
    return wrong(("blackbox", "form"), found, expected, cure)


# readmesh3 hashes vertices so that it slows down twentyfold when 64 divides their number, and never
# ends when 512 does.
BAD_DIVISOR = 64
# keywords of medit's binary format
_DIMENSION, _VERTICES, _TETRAHEDRA, _END = 3, 4, 8, 54


def padding(nodes: np.ndarray) -> np.ndarray:
    """Corners (4, 3) of a tet of its own, beside the mesh; empty (0, 3) unless the vertex count is
    a bad one.
    """
    if len(nodes) % BAD_DIVISOR:
        return np.zeros((0, 3))
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    size = 0.1 * np.linalg.norm(high - low)
    return high + size * np.array([[1.0, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]])


def encode(model: Model) -> bytes:
    """The file's bytes. Regions are written as they are, vertex and tet order is kept, padding
    comes last. Of ten-node tets the corners
    alone are written: FreeFEM numbers the other nodes itself. Raises ValueError when a node belongs
    to no tet (FreeFEM ends on such
    meshes)."""
    if not (np.bincount(model.cells.ravel(), minlength=len(model.nodes)) > 0).all():
        raise ValueError(f"{model.name}: a node belongs to no tet")
    nodes, cells = model.nodes, model.cells
    if cells.shape[1] == 10:
        used, cells = np.unique(cells[:, :4], return_inverse=True)
        nodes, cells = nodes[used], cells.reshape(-1, 4)
    n, extra = len(nodes), padding(nodes)
    padded = int(len(extra) > 0)

    vertices = np.zeros(n + len(extra), [("x", "<f8", 3), ("label", "<i4")])
    vertices["x"][:n] = nodes
    vertices["x"][n:] = extra
    tets = np.empty((len(cells) + padded, 5), "<i4")
    tets[: len(cells), :4] = cells
    tets[: len(cells), 4] = model.region
    if padded:
        tets[-1] = [n, n + 1, n + 2, n + 3, model.region[0]]
    tets[:, :4] += 1

    parts, at = [struct.pack("<5i", 1, 2, _DIMENSION, 20, 3)], 20
    for keyword, table in ((_VERTICES, vertices), (_TETRAHEDRA, tets)):
        at += 12 + table.nbytes
        parts += [struct.pack("<3i", keyword, at, len(table)), table.tobytes()]
    parts.append(struct.pack("<2i", _END, 0))
    return b"".join(parts)
