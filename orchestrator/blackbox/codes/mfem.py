"""Linear elasticity by MFEM (pip install mfem)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.scene.elasticity import lame


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
