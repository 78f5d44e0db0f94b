"""The class of a solver in Python: where it is, whether it has what it needs, and the models that it is handed."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orchestrator.blackbox.protocol import Model

METHODS = ("stiffness", "prepare", "solve")
NO_SOLVER = 67  # exit code


class NoSolver(Exception):
    """The code names no class that could answer."""


def solver_class(code: str) -> type:
    """The class that ``package.module:Class``, ``file.py:Class`` or ``file.py`` (class ``Solver``) names.

    Raises NoSolver when there is none, or when it lacks a method.
    """
    where, _, name = code.rpartition(":") if ":" in code else (code, "", "Solver")
    if where.endswith(".py"):
        spec = importlib.util.spec_from_file_location(Path(where).stem, where)
        module = importlib.util.module_from_spec(spec)
        sys.path.insert(0, str(Path(where).resolve().parent))
        sys.modules[spec.name] = module  # as an import would: dataclasses look their module up
        spec.loader.exec_module(module)
    else:
        module = importlib.import_module(where)
    found = getattr(module, name, None)
    if not isinstance(found, type):
        others = [n for n, value in vars(module).items() if isinstance(value, type) and value.__module__ == module.__name__]
        raise NoSolver(f"{Path(where).name} has no class {name}" + (f", but {', '.join(others)}" if others else ""))
    wanted = METHODS + (("advance", "commit") if getattr(found, "nonlinear", False) else ())
    lacking = [method for method in wanted if not callable(getattr(found, method, None))]
    if lacking:
        raise NoSolver(f"class {name} of {Path(where).name} has no method {', '.join(lacking)}")
    return found


def made(found: type, options: dict[str, object]):
    """The solver; raises NoSolver for options that its class does not take."""
    try:
        inspect.signature(found).bind(**options)
    except TypeError as wrong:
        taken = [name for name in inspect.signature(found).parameters]
        raise NoSolver(f"class {found.__name__} of {found.__module__}: {wrong}; it takes "
                       + (", ".join(taken) or "no options")) from None
    return found(**options)


def promised(solver) -> int:
    """What a solver's class says of it, as ``messages.check_hello`` reads it."""
    promises = ("translation_invariant", "own_matter", "nonlinear")
    return sum(bool(getattr(solver, name, False)) << bit for bit, name in enumerate(promises))


@dataclass
class FullModel(Model):
    """What the methods of a solver get, see ``template``: with ``Origin.arrays``; soles alone have no node in the mesh."""

    number: np.ndarray | None = None
    volume: np.ndarray | None = None
    sole: np.ndarray | None = None
    volumes: tuple[str, ...] = ()


def read_model(path: str) -> FullModel:
    """A model from the file that ``python_code`` writes."""
    with np.load(path) as data:
        found = {name: data[name] for name in data.files}
    return FullModel(**{**found, "name": str(found["name"]), "volumes": tuple(found["volumes"].tolist())})
