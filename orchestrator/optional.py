"""Packages that not everybody needs: each is imported where it is first used, and asked for by name
where it is not there.

``pyproject.toml`` says which extra brings which.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from orchestrator.errors import InputError, wrong

# Package → the extra that brings it, and what it is for.
WANTED = {
    "gmsh": ("mesh",
             "it makes meshes of STEP and BREP files and of grains, and reads those of most "
             "formats"),
    "pymetis": ("mesh", "it cuts meshes into subdomains and shares these among ranks"),
    "numba": ("fast", "it compiles the loops that contact and friction take"),
    "matplotlib": ("figures", "it draws charts"),
    "pyvista": ("figures", "it draws pictures of meshes and fields"),
    "vtkmodules": ("figures", "it draws, and reads .vtk and .vtu files"),
    "mpi4py": ("cluster", "it lets several processes solve one problem"),
}
DRAWING = ("matplotlib", "pyvista", "vtkmodules")


def need(package: str) -> ModuleType:
    """A package; raises InputError: it is not installed."""
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:  # it is there, and lacks something itself
            raise
        raise missing(package) from error


def missing(package: str) -> InputError:
    """The error to raise where a package is not installed."""
    what = WANTED[package][1]
    return wrong((), f"the package {package} is not installed", f"{package}: {what}",
                 command(package))


def command(package: str) -> str:
    """The command that installs it."""
    return f"pip install 'latin-orchestrator[{WANTED[package][0]}]'"


def check_there(package: str) -> None:
    """Raises InputError: it is not installed; nothing is imported."""
    if absent(package):
        raise missing(package)


def absent(*packages: str) -> list[str]:
    """Packages that are not installed; nothing is imported."""
    return [name for name in packages if find_spec(name) is None]


class Late:
    """Stands for a package, which is imported when something of it is first asked for; a needed one
    that is not there is told.
    """

    def __init__(self, package: str):
        self._package = package

    def __getattr__(self, name: str) -> Any:
        found = getattr(need(self._package) if self._package in WANTED
                        else import_module(self._package), name)
        setattr(self, name, found)
        return found
