"""Where meshes come from: one function per key under ``mesh:``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from orchestrator.errors import InputError, Problem
from orchestrator.scene import cad, files, polycrystal, structured
from orchestrator.scene.faces import Faces
from orchestrator.scene.model import Mesh
from orchestrator.scene.quality import checked

SOURCES: dict[str, Callable[[Any], Mesh]] = {
    "beam": structured.beam,
    "box": structured.box,
    "file": files.file,
    "polycrystal": polycrystal.polycrystal,
    "step": cad.step,
}


def make_mesh(mesh: Any) -> tuple[Mesh, Faces]:
    """Makes, scales and checks the mesh of the configuration's ``mesh`` entry.

    ``scale`` multiplies the finished coordinates, so sizes and h are in unscaled units.

    Raises
    ------
    InputError : the source is missing or bad, or what it gives is no valid mesh
    """
    given = [key for key in SOURCES if getattr(mesh, key, None) is not None]
    if len(given) != 1:
        raise InputError(Problem(("mesh",), f"{len(given)} mesh sources" + (f": {', '.join(given)}" if given else ""),
                                 "exactly one of " + ", ".join(SOURCES), "keep one"))
    made = SOURCES[given[0]](mesh)
    scale = getattr(mesh, "scale", None)
    if scale is not None:
        made.nodes = made.nodes * float(scale)
    return checked(made)
