"""The base of solvers written in Python: a stiffness matrix suffices, SciPy does the rest.

    from orchestrator.blackbox.codes.adapter import Adapter

    class Solver(Adapter):
        def stiffness(self, model):
            return my_code.assemble(model.nodes, model.cells, model.materials[model.region])

Whoever has a factorisation of their own overrides ``prepare`` and ``solve`` as well. What arrives
is told in ``template``.
"""

from __future__ import annotations

import importlib.util
import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.linalg import symmetric_lu


class Adapter:
    """Keyword arguments of a subclass are the ``options`` of its entry in the YAML.
    translation_invariant : answers depend neither on where a model is nor on what it or its volumes
        are called
    own_matter : its matter is its own, not the YAML's moduli
    elements : those it knows
    package : the Python package that it needs beside itself, if any; of a solver with a name in the
        registry
    """

    translation_invariant = own_matter = False
    package = ""
    elements: tuple[str, ...] = ("P1",)

    def stiffness(self, model: Any) -> sp.csr_array:
        """(3n, 3n) symmetric stiffness of all tets, nothing clamped, dof = 3 * node + component."""
        raise NotImplementedError

    def prepare(self, model: Any, stiffness: sp.csr_array) -> Any:
        """Clamp and factorise, once per model; whatever is returned comes back in ``solve``."""
        free = np.flatnonzero(~model.fixed)
        return free, symmetric_lu(stiffness[free][:, free])

    def solve(self, prepared: Any, forces: np.ndarray) -> np.ndarray:
        """(rhs, 3n) nodal forces to (rhs, 3n) nodal displacements, zero where clamped."""
        free, factor = prepared
        displacements = np.zeros_like(forces)
        displacements[:, free] = factor.solve(np.ascontiguousarray(forces[:, free].T)).T
        return displacements


# ---- the class of a solver: where it is, what it needs, the models that it is handed -----------

METHODS = ("stiffness", "prepare", "solve")
NO_SOLVER = 67  # exit code


class NoSolver(Exception):
    """The code names no class that could answer."""


def solver_class(code: str) -> type:
    """The class that ``package.module:Class``, ``file.py:Class`` or ``file.py`` (class ``Solver``)
    names. Raises NoSolver when there is
    none, or when it lacks a method."""
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
        others = [n for n, value in vars(module).items() if isinstance(value, type)
                  and value.__module__ == module.__name__]
        raise NoSolver(f"{Path(where).name} has no class {name}"
                       + (f", but {', '.join(others)}" if others else ""))
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
    """The traits that a solver's class declares, as ``messages.check_hello`` reads it."""
    promises = ("translation_invariant", "own_matter", "nonlinear")
    return sum(bool(getattr(solver, name, False)) << bit for bit, name in enumerate(promises))


@dataclass
class FullModel(Model):
    """The model that the methods of a solver get, see ``template``: with ``Origin.arrays``; soles
    alone have no node in the mesh.
    """

    number: np.ndarray | None = None
    volume: np.ndarray | None = None
    sole: np.ndarray | None = None
    volumes: tuple[str, ...] = ()


def read_model(path: str) -> FullModel:
    """A model from the file that ``python_code`` writes."""
    with np.load(path) as data:
        found = {name: data[name] for name in data.files}
    return FullModel(**{**found, "name": str(found["name"]),
                        "volumes": tuple(found["volumes"].tolist())})


AGREE = 1e-9  # relative difference that rounding may leave on sound models
ROUGH = 1e-4  # below it, a difference looks like missing digits rather than like a mistake


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference relative to the largest expected entry."""
    scale = np.abs(expected).max(initial=0.0)
    return float(np.abs(found - expected).max(initial=0.0) / (scale or 1.0))


def diagnosis(found: np.ndarray, expected: np.ndarray) -> str:
    """Say what is wrong with displacements (rhs, 3n); empty when they are right.

    found, expected : a row per load case, dof = 3 * node + component
    """
    if found.shape != expected.shape:
        return (
            f"{'x'.join(map(str, found.shape))} values for {'x'.join(map(str, expected.shape))}"
            " expected: a row per load case, a column per dof"
        )
    if not np.isfinite(found).all():
        return "values that are not finite"
    if (apart := difference(found, expected)) <= AGREE:
        return ""
    still = (expected == 0).all(axis=0) & found.any(axis=0)
    if still.any() and difference(np.where(still, 0.0, found), expected) <= AGREE:
        return f"clamped dofs move: {int(still.sum())} of them"
    missing = [i for i in range(len(expected)) if not found[i].any() and expected[i].any()]
    if missing:
        return (
            f"load case {missing[0] + 1} of {len(expected)} was not answered: all its "
            "displacements are zero")
    order = [next((j for j, row in enumerate(expected) if difference(f, row) <= AGREE), -1)
             for f in found]
    if -1 not in order and order != list(range(len(order))):
        return f"load cases in another order: {', '.join(str(i + 1) for i in order)}"
    factor = float(np.sum(found * expected) / np.sum(expected**2))
    if abs(factor - 1) > ROUGH and difference(found,
                                              factor * expected) <= AGREE * max(abs(factor), 1.0):
        if abs(factor + 1) <= AGREE:
            return "the opposite sign: displacements along the forces are expected"
        return (
            f"{factor:.6g} times what is expected: are forces, lengths and moduli in the units of "
            "the model?")
    nodes = expected.shape[1] // 3
    if 3 * nodes == expected.shape[1] and difference(
        found.reshape(-1, 3, nodes).swapaxes(1, 2).reshape(found.shape), expected) <= AGREE:
        return "dofs component after component: 3 * node + component is expected"
    if difference(np.sort(found, axis=1), np.sort(expected, axis=1)) <= AGREE:
        return (
            "the right displacements at the wrong dofs: nodes are numbered otherwise than in the "
            "model")
    if apart <= ROUGH:
        return (
            f"{-np.log10(apart):.0f} right digits only: single precision, or numbers written with "
            "few digits")
    return f"relative difference {apart:.1e}"
