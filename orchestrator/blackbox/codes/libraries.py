"""Linear elasticity by libraries of finite elements: worked examples of "bring your own solver".

Everything they are asked for is their stiffness; factorisation, processes, messages, checks and
errors are not their business. A package is imported where it is used: to know the class, as who
reads a configuration does, takes none.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.protocol import Model
from orchestrator.scene.elasticity import lame
from orchestrator.scene.mesh.quadratic import TET_EDGES


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
        mesh = MeshTet(np.ascontiguousarray(model.nodes[corners].T), np.ascontiguousarray(cells.reshape(-1, 4).T))
        basis = Basis(mesh, ElementVector(ElementTetP2() if quadratic else ElementTetP1()), intorder=2 if quadratic else 1)
        constant = basis.with_element(ElementTetP0())
        lam, mu = (constant.interpolate(values[model.region]) for values in lame(*model.materials.T))
        matrix = sp.coo_array(BilinearForm(elasticity).assemble(basis, lam=lam, mu=mu))
        place = np.empty(basis.N, dtype=int)  # of scikit-fem's dofs in the protocol's order
        place[basis.nodal_dofs] = 3 * corners + np.arange(3)[:, None]
        if quadratic:
            place[basis.edge_dofs] = 3 * _middles(model.cells, corners[mesh.edges]) + np.arange(3)[:, None]
        return sp.csr_array((matrix.data, (place[matrix.row], place[matrix.col])), shape=(model.fixed.size,) * 2)


def _middles(cells: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(e,) nodes in the middle of edges (2, e), given by their ends."""
    size = int(cells.max()) + 1
    low, high = np.sort(cells[:, TET_EDGES], axis=2).reshape(-1, 2).T
    keys, first = np.unique(low * size + high, return_index=True)
    low, high = np.sort(ends, axis=0)
    return cells[:, 4:].ravel()[first[np.searchsorted(keys, low * size + high)]]


class NGSolve(Adapter):
    """NGSolve, through its Python interface, on four-node tets."""

    package = "ngsolve"
    translation_invariant = True

    def stiffness(self, model) -> sp.csr_array:
        from netgen.meshing import Mesh as NetgenMesh
        from ngsolve import (BilinearForm, CoefficientFunction, Grad, Id, InnerProduct, Mesh,
                             Trace, VectorH1, dx)

        netgen = NetgenMesh(dim=3)
        netgen.AddPoints(np.ascontiguousarray(model.nodes, dtype=np.float64))
        for region in range(len(model.materials)):
            tets = model.cells[model.region == region]
            netgen.AddElements(dim=3, index=region + 1, data=np.ascontiguousarray(tets, dtype=np.int32), base=0)
            netgen.SetMaterial(region + 1, f"region {region}")
        space = VectorH1(Mesh(netgen), order=1)
        lam, mu = (CoefficientFunction(list(map(float, values))) for values in lame(*model.materials.T))
        u, v = space.TnT()
        strain = 0.5 * (Grad(u) + Grad(u).trans)
        form = BilinearForm(InnerProduct(lam * Trace(strain) * Id(3) + 2 * mu * strain, Grad(v)) * dx).Assemble()
        rows, columns, values = (np.asarray(part) for part in form.mat.COO())
        place = np.arange(model.fixed.size).reshape(-1, 3).T.ravel()  # NGSolve's order: all of x, then y, then z
        return sp.csr_array((values, (place[rows], place[columns])), shape=(model.fixed.size,) * 2)


class Mfem(Adapter):
    """MFEM, through its Python interface, on four-node tets."""

    package = "mfem"
    translation_invariant = True

    def stiffness(self, model) -> sp.csr_array:
        import mfem.ser as mfem

        mesh = self._mesh(model, mfem.Mesh)
        collection = mfem.H1_FECollection(1, 3)
        space = mfem.FiniteElementSpace(mesh, collection, 3, mfem.Ordering.byVDIM)
        lam, mu = (mfem.PWConstCoefficient(mfem.Vector(np.ascontiguousarray(values))) for values in lame(*model.materials.T))
        form = mfem.BilinearForm(space)
        form.AddDomainIntegrator(mfem.ElasticityIntegrator(lam, mu))
        form.Assemble()
        form.Finalize()
        matrix = form.SpMat()
        apart = sp.csr_array((matrix.GetDataArray(), matrix.GetJArray(), matrix.GetIArray()), shape=(matrix.Size(),) * 2)
        apart = sp.coo_array(apart)
        dof = (3 * model.cells.reshape(-1, 1) + np.arange(3)).ravel()  # of each of its own
        return sp.csr_array((apart.data, (dof[apart.row], dof[apart.col])), shape=(model.fixed.size,) * 2)

    @staticmethod
    def _mesh(model, read):
        """Every tet with nodes of its own, in MFEM's text format, the quickest way in from Python: soles may overlap,
        and MFEM takes no face with three tets."""
        with tempfile.TemporaryDirectory() as folder, open(Path(folder) / "model.mesh", "w") as file:
            file.write(f"MFEM mesh v1.0\n\ndimension\n3\n\nelements\n{len(model.cells)}\n")
            tet = np.full((len(model.cells), 1), 4)
            np.savetxt(file, np.hstack([model.region[:, None] + 1, tet, np.arange(model.cells.size).reshape(-1, 4)]), "%d")
            file.write(f"\nboundary\n0\n\nvertices\n{model.cells.size}\n3\n")
            np.savetxt(file, model.nodes[model.cells.ravel()], "%.17g")
            file.flush()
            return read(file.name, 0, 0, False)
