"""Linear elasticity by scikit-fem: the worked example of "bring your own solver".

Everything scikit-fem is asked for is in three methods; processes, messages, checks and errors are the server's.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from skfem import Basis, BilinearForm, ElementTetP0, ElementTetP1, ElementVector, MeshTet
from skfem.helpers import ddot, eye, sym_grad, trace

from orchestrator.blackbox.protocol import Model
from orchestrator.scene.elasticity import lame


@BilinearForm
def elasticity(u, v, w):
    """σ(u) : ε(v), isotropic; λ and μ are constant on each tet."""
    strain = sym_grad(u)
    stress = eye(w["lam"] * trace(strain), 3) + 2.0 * w["mu"] * strain
    return ddot(stress, sym_grad(v))


class ScikitFem:
    """Linear elasticity on four-node tets."""

    def stiffness(self, model: Model) -> sp.csr_array:
        """(3n, 3n), nothing clamped, dof = 3 * node + component."""
        mesh = MeshTet(np.ascontiguousarray(model.nodes.T), np.ascontiguousarray(model.cells.T))
        basis = Basis(mesh, ElementVector(ElementTetP1()), intorder=1)
        constant = basis.with_element(ElementTetP0())
        lam, mu = (constant.interpolate(values[model.region]) for values in lame(*model.materials.T))
        matrix = elasticity.assemble(basis, lam=lam, mu=mu)
        dofs = basis.nodal_dofs.T.ravel()  # scikit-fem's numbers, in the protocol's order
        return sp.csr_array(matrix[dofs][:, dofs])

    def prepare(self, model: Model) -> tuple:
        """Clamped and factorised, once per model."""
        free = np.flatnonzero(~model.fixed)
        matrix = sp.csc_array(self.stiffness(model)[free][:, free])
        factor = spla.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return free, factor

    def solve(self, prepared: tuple, forces: np.ndarray) -> np.ndarray:
        """(rhs, 3n) nodal forces to (rhs, 3n) nodal displacements, zero where clamped."""
        free, factor = prepared
        displacements = np.zeros_like(forces)
        displacements[:, free] = factor.solve(np.ascontiguousarray(forces[:, free].T)).T
        return displacements
