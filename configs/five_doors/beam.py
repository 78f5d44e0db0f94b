"""The beam: boards glued along x, whose stiffness along the fibres is so many times that of the YAML's moduli across."""

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.adapter import Adapter
from orchestrator.blackbox.codes.template import Solver as Isotropic


class Solver(Adapter):
    """``fibres`` adds to the modulus along x, in units of Young's modulus; soles stay as they are."""

    own_matter = True

    def __init__(self, fibres: float = 1.0):
        self.fibres = fibres

    def stiffness(self, model):
        edges = model.nodes[model.cells][:, 1:] - model.nodes[model.cells][:, :1]
        inverse = np.linalg.inv(edges)
        along = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)[:, 0]  # (m, 4) derivatives along x
        extra = np.where(model.sole, 0.0, self.fibres * model.materials[model.region][:, 0] * np.linalg.det(edges) / 6)
        dofs, values = 3 * model.cells, (extra[:, None, None] * along[:, :, None] * along[:, None]).ravel()
        places = np.repeat(dofs, 4, axis=1).ravel(), np.tile(dofs, (1, 4)).ravel()
        return Isotropic().stiffness(model) + sp.csr_array((values, places), shape=(model.fixed.size,) * 2)
