"""Where meshes come from: one function per key under ``mesh:``, in a module that only its users load."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from orchestrator.errors import InputError, Problem
from orchestrator.scene.mesh.faces import Faces
from orchestrator.scene.mesh.quality import checked
from orchestrator.scene.model import Mesh

# key and name of the function → its module in ``orchestrator.scene``
SOURCES = {"beam": "mesh.structured", "box": "mesh.structured", "file": "mesh.files",
           "polycrystal": "grains.polycrystal", "step": "mesh.cad"}


# gives a mesh, asking the function for it if it has to be made
Keeper = Callable[[Callable[[], Mesh]], Mesh]


def make_mesh(mesh: Any, kept: Keeper = lambda make: make()) -> tuple[Mesh, Faces]:
    """Makes, scales and checks the mesh of the configuration's ``mesh`` entry.

    ``scale`` multiplies the finished coordinates, so sizes and h are in unscaled units.

    Parameters
    ----------
    kept : may know the mesh from an earlier run

    Raises
    ------
    InputError : the source is missing or bad, or what it gives is no valid mesh
    """
    given = [key for key in SOURCES if getattr(mesh, key, None) is not None]
    if len(given) != 1:
        raise InputError(Problem(("mesh",), f"{len(given)} mesh sources" + (f": {', '.join(given)}" if given else ""),
                                 "exactly one of " + ", ".join(SOURCES), "keep one"))
    source = getattr(import_module(f"orchestrator.scene.{SOURCES[given[0]]}"), given[0])
    made = kept(lambda: source(mesh))
    scale = getattr(mesh, "scale", None)
    if scale is not None:
        made.nodes = made.nodes * float(scale)
    return checked(made)
