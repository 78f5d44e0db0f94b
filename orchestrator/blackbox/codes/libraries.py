"""Linear elasticity by libraries of finite elements: worked examples of "bring your own solver".

Everything they are asked for is their stiffness; factorisation, processes, messages, checks and
errors are not their business. A package is imported where it is used: to know the class, as who
reads a configuration does, takes none.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.protocol import Model
from orchestrator.scene.elasticity import lame
from orchestrator.scene.mesh.quadratic import edges_of, find, TET_EDGES


class ScikitFem(Adapter):
    """scikit-fem, a pure Python finite element library, on four- and ten-node tets."""

    package = "scikit-fem"
    translation_invariant = True
    elements = ("P1", "P2")

    def stiffness(self, model: Model) -> sp.csr_array:
        """Stiffness of σ(u) : ε(v), isotropic, λ and μ constant on each tet."""
        from skfem import (Basis, BilinearForm, ElementTetP0, ElementTetP1, ElementTetP2,
                           ElementVector, MeshTet)
        from skfem.helpers import ddot, eye, sym_grad, trace

        def elasticity(u, v, w):
            strain = sym_grad(u)
            return ddot(eye(w["lam"] * trace(strain), 3) + 2.0 * w["mu"] * strain, sym_grad(v))

        quadratic = model.cells.shape[1] == 10
        corners, cells = np.unique(model.cells[:, :4], return_inverse=True)
        mesh = MeshTet(np.ascontiguousarray(model.nodes[corners].T),
                       np.ascontiguousarray(cells.reshape(-1, 4).T))
        basis = Basis(mesh, ElementVector(ElementTetP2() if quadratic else ElementTetP1()),
                      intorder=2 if quadratic else 1)
        constant = basis.with_element(ElementTetP0())
        lam, mu = (constant.interpolate(values[model.region])
                   for values in lame(*model.materials.T))
        matrix = sp.coo_array(BilinearForm(elasticity).assemble(basis, lam=lam, mu=mu))
        place = np.empty(basis.N, int)  # of scikit-fem's dofs in the protocol's order
        place[basis.nodal_dofs] = 3 * corners + np.arange(3)[:, None]
        if quadratic:
            ends, edge = edges_of(model.cells[:, :4], TET_EDGES)
            middle = np.empty(len(ends), int)
            middle[edge] = model.cells[:, 4:]
            place[basis.edge_dofs] = np.arange(3)[:, None] + 3 * middle[
                find(ends, corners[mesh.edges].T)]
        return sp.csr_array((matrix.data, (place[matrix.row], place[matrix.col])),
                            shape=(model.fixed.size,) * 2)
