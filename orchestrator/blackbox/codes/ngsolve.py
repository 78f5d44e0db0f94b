"""Linear elasticity by NGSolve (pip install ngsolve)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.scene.elasticity import lame


class NGSolve(Adapter):
    """NGSolve, through its Python interface, on four-node tets."""

    package = "ngsolve"
    translation_invariant = True

    def stiffness(self, model) -> sp.csr_array:
        from netgen.meshing import Mesh as NetgenMesh
        from ngsolve import BilinearForm, CoefficientFunction, Grad, Id, InnerProduct, Mesh, Trace, VectorH1, dx

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
