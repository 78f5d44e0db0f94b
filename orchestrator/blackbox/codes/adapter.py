"""The base of solvers written in Python: a stiffness matrix suffices, SciPy does the rest.

    from orchestrator.blackbox.codes.adapter import Adapter

    class Solver(Adapter):
        def stiffness(self, model):
            return my_code.assemble(model.nodes, model.cells, model.materials[model.region])

Whoever has a factorisation of their own overrides ``prepare`` and ``solve`` as well. What arrives is told in ``template``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla


class Adapter:
    """Keyword arguments of a subclass are the ``options`` of its entry in the YAML.
    translation_invariant : answers depend neither on where a model is nor on what it or its volumes are called
    own_matter : its matter is its own, not the YAML's moduli
    elements : those it knows
    package : the Python package that it needs beside itself, if any; of a solver with a name in the registry
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
        held = sp.csc_array(stiffness[free][:, free])
        return free, spla.splu(held, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(self, prepared: Any, forces: np.ndarray) -> np.ndarray:
        """(rhs, 3n) nodal forces to (rhs, 3n) nodal displacements, zero where clamped."""
        free, factor = prepared
        displacements = np.zeros_like(forces)
        displacements[:, free] = factor.solve(np.ascontiguousarray(forces[:, free].T)).T
        return displacements
