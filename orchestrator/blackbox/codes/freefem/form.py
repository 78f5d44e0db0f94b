"""A form of the user's in FreeFEM's language as the matter of subdomains.

The form is a file of macros and functions: ``Stiffness(u, v)``, and ``Loads(v)`` if it has loads of its own. The server's
scripts stand around it; what it may use is in ``form_names.idp``, what it is judged by in ``form.idp``.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.blackbox.codes.freefem.installation import script
from orchestrator.errors import InputError, Problem

if TYPE_CHECKING:
    from orchestrator.blackbox.protocol import Model

FORM_SERVER = "form_server.edp"
_BEFORE, _AFTER = ("elasticity.idp", "form_names.idp"), ("form.idp", "serve.idp")
_REFUSALS = "form_refused.idp"  # between the form and what uses its macros
_GIVEN = {"Stiffness", "Loads"}  # names that a form is there to define
_DEFINED = re.compile(r"^[ \t]*(?:macro|func|NewMacro|real|int|bool|matrix|fespace|mesh3|string)(?:\s*\[[^\]]*\])*[ \t]+(\w+)",
                      re.MULTILINE)
_WORD = re.compile(r"[A-Za-z]\w*")
_REFUSED = re.compile(r"Identifier refused(\w+) does not exist")  # FreeFEM's words where a form uses one of ``_REFUSALS``
_COMPLAINS = re.compile(r"rror|does not exist")


def form_server(form: Path) -> str:
    """The script of a server whose matter is the form's."""
    files = [*map(script, _BEFORE), form.absolute(), *map(script, (_REFUSALS, *_AFTER))]
    return 'load "bfstream"\n' + "".join(f'include "{file}"\n' for file in files)


def check_form(form: Path) -> None:
    """Raises InputError where the form is not there, lacks its macro, or takes names that the server uses."""
    try:
        text = form.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise _problem(f"{form}: {error.strerror}", "a file with a macro Stiffness(u, v)", "check the path") from error
    bare = _bare(text)
    names = {match[1]: bare[: match.start(1)].count("\n") + 1 for match in _DEFINED.finditer(bare)}
    if "Stiffness" not in names:
        raise _problem(f"{form} without a macro Stiffness", "macro Stiffness(u, v) int3d(Th, mine, qfV = qfV1)(...) // EOM",
                       "define it: u#x is the x component of u, mine are the regions of your matter")
    used = set().union(*(_WORD.findall(re.sub(r"//[^\n]*", "", script(name).read_text(encoding="utf-8")))
                         for name in (*_BEFORE, *_AFTER))) - _GIVEN
    for name, line in names.items():
        if name in used:
            raise _problem(f"{form}:{line}: a name of the form's, {name}, that the server's script uses too",
                           "names of its own", f"call it my{name[0].upper()}{name[1:]}, say")


def refused_term(form: Path, said: str) -> InputError | None:
    """The error to raise where FreeFEM's last lines say that the form has a term which is refused; None where they do not."""
    if (match := _REFUSED.search(said)) is None:
        return None
    name = match[1]
    try:
        text = _bare(form.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        text = ""
    place = re.search(rf"\b{name}\b", text)  # else in a file that it includes
    where = f"{form}:{text[: place.start()].count(chr(10)) + 1}" if place else f"{form}, in a file that it includes"
    if name == "on":
        return _problem(f"{where}: on(...) in Stiffness or Loads", "terms on volumes, int3d(Th, mine, ...): the meshes have no "
                        "labelled faces, and it would hold nothing", "leave it out: supports are entries of boundary")
    if name == "jump":
        return _problem(f"{where}: jump(...) in Stiffness or Loads", "terms of each tet by itself, int3d(Th, mine, ...): what lies "
                        "beyond a face may be another subdomain", "leave it out")
    return _problem(f"{where}: {name}(...) in Stiffness or Loads", "terms on volumes, int3d(Th, mine, ...): the meshes have no "
                    "labelled faces, and it would vanish", "leave it out: pressures and tractions are entries of boundary, a skin "
                    "is a thin volume of the mesh, a bedding a part beneath")


def not_compiled(form: Path, said: str, meaning: str) -> InputError:
    """The error to raise where FreeFEM ends before its first word; its own are quoted."""
    words = [line.strip() for line in said.splitlines() if line.strip()]
    first = next((i for i, line in enumerate(words) if _COMPLAINS.search(line)), max(len(words) - 3, 0))
    return _problem(f"{form}: {meaning}; FreeFEM says: {' / '.join(words[first : first + 3])}", "a form that FreeFEM compiles",
                    "mend the line; where it is not in the form, a name that Stiffness or Loads uses is missing")


def _bare(text: str) -> str:
    """A script without its comments, line by line."""
    return re.sub(r"//[^\n]*", "", re.sub(r"/\*.*?\*/", lambda m: "\n" * m[0].count("\n"), text, flags=re.DOTALL))


def with_volumes(model: Model) -> Model:
    """The model with the mesh's volumes as regions, of moduli zero, and after them the matters of its soles."""
    import numpy as np

    if model.origin is None:  # soles alone
        first, region = 1, 1 + model.region
    else:
        volume = model.origin.arrays(len(model.nodes), len(model.cells))["volume"]
        first = len(model.origin.volumes)
        region = np.where(volume >= 0, volume, first + model.region)
    return replace(model, region=region, materials=np.vstack([np.zeros((first, 2)), model.materials]))


def _problem(found: str, expected: str, cure: str) -> InputError:
    return InputError(Problem(("blackbox", "form"), found, expected, cure))
