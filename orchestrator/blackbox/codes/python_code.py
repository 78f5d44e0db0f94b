"""Black boxes written in Python as codes: how they are found, started, and handed their models."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tempfile
from functools import cache
from importlib import metadata
from importlib.machinery import PathFinder
from importlib.util import find_spec
from importlib.resources import files
from inspect import getfile
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, JsonValue

from orchestrator.blackbox.codes.adapter import NO_SOLVER
from orchestrator.blackbox.codes.code import Code, MessageCode, PATIENCE
from orchestrator.blackbox.protocol import Model, Origin
from orchestrator.config.base import Name
from orchestrator.config.blackbox import CodeSettings
from orchestrator.errors import InputError, wrong

TEMPLATE = Path(__file__).with_name("template.py")
_ROOT = Path(str(files("orchestrator"))).parent  # of the packages: the clone, or site-packages
# What another interpreter runs: this package from where it is, and nothing else that is beside it.
_HOSTED = """import runpy, sys
from importlib.util import module_from_spec, spec_from_file_location
root = sys.argv.pop(1)
spec = spec_from_file_location("orchestrator", root + "/__init__.py",
                               submodule_search_locations=[root])
sys.modules["orchestrator"] = module_from_spec(spec)
spec.loader.exec_module(sys.modules["orchestrator"])
runpy.run_module("orchestrator.blackbox.codes.python_server", run_name="__main__", alter_sys=True)
"""
_NEEDED = "import sys, numpy, scipy; print(*sys.version_info[:2])"
_OLDEST = (3, 9)  # Python that the server's modules still run in


class PythonCode(MessageCode):
    """A class with the three methods of ``template``, in a process of its own.

    As it is, the class is the one that ``code`` in the YAML names. A code with a name of its own
    derives from this one and says which class it means; keys that its ``Settings`` add are keyword
    arguments of that class, as are ``options``.

    solver : ``file.py``, ``file.py:Class`` or ``package.module:Class``; empty: what
        ``settings.code`` says
    package : the Python package it needs beside itself, if any
    Raises InputError when the file, the module or the package is not there.

    Examples
    --------
    >>> import orchestrator
    >>> class ByHand(PythonCode):
    ...     solver = "orchestrator.blackbox.codes.template:Solver"
    >>> orchestrator.CODES.add("by-hand", ByHand)
    >>> orchestrator.solve(orchestrator.config_from({
    ...     "name": "bar", "mesh": {"box": {"size": [2, 1, 1], "cells": [4, 2, 2]}},
    ...     "subdomains": {"slices": {"axis": "x", "count": 2}},
    ...     "materials": [{"young": 200e3, "poisson": 0.3}],
    ...     "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax",
    ...     "traction": [0, 0, 1]}],
    ...     "blackbox": {"code": "by-hand"}}))
    Solution(bar: converged after ... iterations, error bound ...)
    """

    forms: ClassVar[str] = "solver.py, solver.py:Class or package.module:Class"
    solver: ClassVar[str] = ""
    package: ClassVar[str] = ""
    # said by the solver's class, which this process does not import
    translation_invariant, own_matter = None, None
    mesh_suffix = "npz"
    meanings = {1: "an exception in the solver's Python code"}

    class PythonSettings(CodeSettings):
        """A solver in Python."""

        loads: bool = Field(False, description="whether the solver's class brings loads of its "
                                               "own: loads(model, step)")
        options: dict[Name, JsonValue] = Field({
            }, description="keyword arguments of the solver's class")
        python: Name | None = Field(None, description=(
            "the interpreter that the solver's packages are installed for, as /usr/bin/python3, "
            "with numpy and SciPy; none: the orchestrator's own"))
        nonlinear: bool = Field(False, description=(
            "whether the solver's class is nonlinear: advance(prepared, forces) and "
            "commit(prepared), load step by load step"))

        @property
        # as the entry says: the class is imported by its processes alone
        def remembers(self) -> bool:
            return self.nonlinear

        @property
        def brings_loads(self) -> bool:
            return self.loads

        @property
        def unasked(self) -> tuple[str, ...]:
            return (f"whether {self.python} has what {self.code} needs: it is not started",
                    ) if self.python else ()

        @classmethod
        def beside(cls, entry: dict[str, Any], folder: Path) -> dict[str, Any]:
            if (python := entry.get("python")) and (folder / str(python)).is_file():
                entry = {**entry, "python": os.path.abspath(folder / str(python))}
            file, dot, name = str(entry.get("code", "")).partition(".py")
            if not dot or not (folder / f"{file}.py").is_file():
                return entry
            return {**entry, "code": os.path.normpath(folder / f"{file}.py") + name}

    Settings = PythonSettings

    def __init__(self, settings: CodeSettings | None = None):
        super().__init__(settings)
        code = self.solver or self.settings.code
        where = code.rpartition(":")[0] or code
        if self.settings.nonlinear and self.settings.transport != "pipe":
            raise _absent(f"{self.settings.transport} for a nonlinear solver",
                          "a process that remembers load steps",
                          "write transport: pipe, or leave it out", "transport")
        if self.package and not self.settings.python:
            try:
                metadata.version(self.package)
            except metadata.PackageNotFoundError:
                raise _absent(f"no Python package {self.package} in {sys.prefix}",
                              f"the package {self.package}",
                              f"{sys.executable} -m pip install {self.package}") from None
        if where.endswith(".py"):
            if not Path(where).is_file():
                raise _absent(f"no file {where}", "a Python file with a class Solver, or "
                                                  "file.py:Class", f"start from {TEMPLATE}")
            code = str(Path(where).resolve()) + code[len(where):]
        elif not self.settings.python and not (  # the server looks in the current folder too
                find_spec(top := where.partition(".")[0])
                or PathFinder.find_spec(top, [os.getcwd()])):
            raise _absent(f"no Python module {where}",
                          "a module that can be imported, as package.module:Class",
                          "install it in this environment, or add its folder to PYTHONPATH")
        self._code = code

    def ask(self) -> None:
        """The interpreter that the entry names, whether it has what the server needs."""
        if self.settings.python:
            _ask(self.settings.python, self.package)

    @property
    def name(self) -> str:
        """The name in the YAML; of a solver of the user's own the file or the module, without its
        folder and class.
        """
        code = self.settings.code
        return code if self.solver else Path(code.rpartition(":")[0] or code).name

    def command(self, requests: str, replies: str) -> list[str]:
        """Command line of a server that reads and writes these paths."""
        own = self.settings.model_dump(mode="json", exclude={*CodeSettings.model_fields, "loads",
                                                             "nonlinear", "options", "python"})
        server = [self._code, json.dumps({**own, **self.settings.options}), requests, replies]
        # a module of the user's own may be in the current folder; nothing else is looked for there
        # first
        if not self.solver:
            server.append(os.getcwd())
        if self.settings.python:
            return [self.settings.python, "-c", _HOSTED, str(_ROOT / "orchestrator"), *server]
        return [sys.executable, "-P", "-m", "orchestrator.blackbox.codes.python_server", *server]

    def environment(self) -> dict[str, str]:
        """The environment with this package among the modules; another interpreter is told where it
        is.
        """
        if self.settings.python:
            return super().environment()
        return {**super().environment(), "PYTHONPATH": os.pathsep.join(
            [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])}

    def mesh(self, model: Model) -> bytes:
        """The model as it is, in numpy's format."""
        origin, file = model.origin or Origin(*[np.empty(0, int)] * 3, ()), io.BytesIO()
        own = {name: getattr(model, name)
               for name in ("name", "nodes", "cells", "region", "materials", "fixed", "trace")}
        np.savez(file, **own, **origin.arrays(len(model.nodes), len(model.cells)))
        return file.getvalue()

    def missing_part(self, exit_code: int, said: str) -> InputError | None:
        """The class: the module is imported by the process alone, which finds out."""
        if exit_code != NO_SOLVER:
            return None
        return _absent(said.splitlines()[-1], "a class Solver with the methods stiffness, prepare "
                                              "and solve, or another one's name after a colon, as "
                                              "my_solver.py:Mine",
                                              f"name the class in code:, or start from {TEMPLATE}")

    def version(self) -> str:
        """Version of the package it needs; empty for a class of one's own."""
        if not self.package:
            return ""
        return _ask(self.settings.python,
                    self.package) if self.settings.python else metadata.version(self.package)


class FourNodeCode(PythonCode):
    """One whose solver knows four-node tets alone."""

    class FourNodeSettings(PythonCode.Settings):
        """A solver in Python."""

        element: Literal["P1"] = Field("P1",
                                       description="linear tetrahedra: its adapter knows no other")

    Settings = FourNodeSettings


def code_of(named: type) -> type[Code]:
    """A code, or that of an ``Adapter``, whose attributes say what it can do."""
    if issubclass(named, Code):
        return named
    kind = PythonCode if "P2" in named.elements else FourNodeCode
    # of a package, or a file by itself
    where = named.__module__ if "." in named.__module__ else os.path.abspath(getfile(named))
    return type(f"{named.__name__}Code", (kind,), {
        "__doc__": named.__doc__, "__module__": named.__module__,
        "solver": f"{where}:{named.__qualname__}", "package": named.package,
        "translation_invariant": named.translation_invariant, "own_matter": named.own_matter})


@cache
def _ask(python: str, package: str) -> str:
    """Version of the package in another interpreter, which has what the server needs; raises
    InputError.
    """
    lacks = f"an interpreter with numpy, SciPy{' and ' + package if package else ''}"
    code = _NEEDED + (f"; from importlib.metadata import version; print(version({package!r}))"
                      if package else "")
    try:
        # with -c modules of the current folder come first
        with tempfile.TemporaryDirectory(prefix="orchestrator-ask-") as empty:
            done = subprocess.run([os.path.abspath(python) if os.sep in python else python, "-c",
                                   code], capture_output=True,
                                  text=True, timeout=PATIENCE, cwd=empty)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise _absent(f"{python}, which cannot be run: {error}", lacks,
                      "give the path of a Python interpreter", "python") from None
    first, *rest = done.stdout.splitlines() or [""]
    if done.returncode:
        said = (done.stderr.strip() or f"nothing, and ends with {done.returncode}").splitlines()[-1]
        raise _absent(f"{python}, which says: {said}", lacks,
                      "install them for that interpreter, or name another one", "python")
    if not re.fullmatch(r"\d+ \d+", first):
        raise _absent(f"{python}, which does not answer as Python does", lacks,
                      "give the path of a Python interpreter", "python")
    if tuple(map(int, first.split())) < _OLDEST:
        raise _absent(f"{python}, which is Python {first.replace(' ', '.')}",
                      f"Python {_OLDEST[0]}.{_OLDEST[1]} or later",
                      "name another interpreter", "python")
    return rest[0] if rest else ""


def _absent(found: str, expected: str, cure: str, key: str = "code") -> InputError:
    return wrong(("blackbox", key), found, expected, cure)
