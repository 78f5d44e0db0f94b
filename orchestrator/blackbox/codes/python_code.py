"""Black boxes written in Python as codes: how they are found, started, and handed their models."""

from __future__ import annotations

import io
import os
import sys
from importlib import metadata
from importlib.machinery import PathFinder
from importlib.resources import files
from pathlib import Path

import numpy as np

from orchestrator.blackbox.pool.exits import exit_meaning
from orchestrator.blackbox.transport.file import FileWorker
from orchestrator.blackbox.transport.pipe import PipeWorker
from orchestrator.blackbox.protocol import Model
from orchestrator.errors import InputError, Problem

TEMPLATE = Path(__file__).with_name("template.py")
_ROOT = Path(str(files("orchestrator"))).parent  # of the packages: the clone, or site-packages
_MEANINGS = {1: "an exception in the solver's Python code"}


class PythonCode:
    """A class with the three methods of ``template``, in a process of its own.

    Parameters
    ----------
    name : for messages
    code : ``file.py``, ``file.py:Class`` or ``package.module:Class``
    package, install : what it needs beside itself, and how to get it

    Raises InputError when the file, the module or the package is not there: nothing has been started yet.
    """

    elements = ("P1",)
    transports = {"pipe": PipeWorker, "file": FileWorker}
    mesh_suffix = "npz"

    def __init__(self, name: str, code: str, package: str = "", install: str = ""):
        self.name, self.code, self.package = name, code, package
        where = code.rpartition(":")[0] or code
        if package and not _installed(package):
            raise _absent(f"no Python package {package} in {sys.prefix}", f"the package {package}", install)
        if where.endswith(".py"):
            if not Path(where).is_file():
                raise _absent(f"no file {where}", "a Python file with a class Solver, or file.py:Class",
                              f"start from {TEMPLATE}")
            self.code = str(Path(where).resolve()) + code[len(where):]
        elif not _importable(where):
            raise _absent(f"no Python module {where}", "a module that can be imported, as package.module:Class",
                          "install it in this environment, or add its folder to PYTHONPATH")

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a server that reads and writes these paths."""
        return [sys.executable, "-m", "orchestrator.blackbox.codes.python_server", self.code, requests, replies]

    @staticmethod
    def environment() -> dict[str, str]:
        """Environment of the child process: one thread, since parallelism is over subdomains."""
        path = os.pathsep.join([str(_ROOT), *filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")])])
        return {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

    @staticmethod
    def mesh(model: Model) -> bytes:
        """Bytes of the model's file."""
        file = io.BytesIO()
        np.savez(file, name=model.name, nodes=model.nodes, cells=model.cells, region=model.region,
                 materials=model.materials, fixed=model.fixed, trace=model.trace)
        return file.getvalue()

    @staticmethod
    def meaning(exit_code: int) -> str:
        """What an exit code (negative: killed by that signal) says."""
        return exit_meaning(exit_code, _MEANINGS)

    def version(self) -> str:
        """Version of the package it needs; empty for a class of one's own."""
        return metadata.version(self.package) if self.package else ""

    @staticmethod
    def missing_plugin(exit_code: int) -> None:
        """Nothing beside the package."""


def scikit_fem() -> PythonCode:
    """scikit-fem, the worked example."""
    return PythonCode("scikit-fem", "orchestrator.blackbox.codes.scikit_fem:ScikitFem", "scikit-fem",
                      f"{sys.executable} -m pip install scikit-fem")


def _importable(module: str) -> bool:
    """Whether the server will find a module, or the package it is in; the current folder counts."""
    return PathFinder.find_spec(module.partition(".")[0], [*sys.path, os.getcwd()]) is not None


def _installed(package: str) -> bool:
    try:
        metadata.version(package)
    except metadata.PackageNotFoundError:
        return False
    return True


def _absent(found: str, expected: str, cure: str) -> InputError:
    return InputError(Problem(("blackbox", "code"), found, expected, cure))
