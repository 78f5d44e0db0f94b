"""Elastoplastic tets as a solver of one's own: von Mises' yield condition, linear hardening, small strains.

    blackbox:
      - {code: elastoplastic.py, on: tube, nonlinear: true, options: {yield_stress: 250, hardening: 2000}}

The matter is elastic with the YAML's moduli until it yields. Radial return (Simo and Hughes, Computational Inelasticity,
1998, box 3.2); ``hardening`` is the slope of the yield stress over the equivalent plastic strain, of which ``kinematic``
moves the yield surface and the rest widens it.
"""

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.codes.nonlinear_adapter import NonlinearAdapter
from orchestrator.blackbox.codes.template import Solver as Elastic

# strains and stresses as xx, yy, zz, xy, yz, xz; shear strains twice the tensor's
UNIT = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
DEVIATOR = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5]) - np.outer(UNIT, UNIT) / 3  # of a strain, as the tensor's components
TWICE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # how often a component is in the tensor


class Solver(NonlinearAdapter):
    """Keyword arguments are the options of the entry in the YAML, in its units."""

    def __init__(self, yield_stress: float, hardening: float, kinematic: float = 0.0):
        if not (yield_stress > 0 and hardening >= 0 and 0 <= kinematic <= 1):
            raise ValueError("yield_stress must be > 0, hardening >= 0, and kinematic a share of it between 0 and 1")
        self.yield_stress, self.hardening, self.kinematic = yield_stress, hardening, kinematic

    def stiffness(self, model):
        return Elastic().stiffness(model)

    def response(self, model, u, history):
        mesh = self._mesh(model)
        strain = np.einsum("mij,mj->mi", mesh.B, u[mesh.dofs])
        plastic, back, amount = history or (np.zeros_like(strain), np.zeros_like(strain), np.zeros(len(strain)))
        young, poisson = model.materials[model.region].T
        bulk, mu = young / (3 * (1 - 2 * poisson)), young / (2 * (1 + poisson))
        elastic = strain - plastic * TWICE
        deviatoric = 2 * mu[:, None] * (elastic @ DEVIATOR)
        apart = deviatoric - back
        size = np.sqrt(np.sum(TWICE * apart**2, axis=1))
        iso, kin = (1 - self.kinematic) * self.hardening, self.kinematic * self.hardening
        excess = size - np.sqrt(2 / 3) * (self.yield_stress + iso * amount)
        flow = np.where(excess > 0, excess / (2 * mu + 2 / 3 * self.hardening), 0.0)  # plastic multiplier
        along = apart / np.where(size > 0, size, 1.0)[:, None]
        stress = bulk[:, None] * (elastic @ UNIT)[:, None] * UNIT + deviatoric - (2 * mu * flow)[:, None] * along
        kept = np.where(excess > 0, 1 - 2 * mu * flow / np.where(size > 0, size, 1.0), 1.0)
        bent = np.where(excess > 0, 2 * mu / (2 * mu + 2 / 3 * self.hardening) - (1 - kept), 0.0)
        tangent = (bulk[:, None, None] * np.outer(UNIT, UNIT) + (2 * mu * kept)[:, None, None] * DEVIATOR
                   - (2 * mu * bent)[:, None, None] * along[:, :, None] * along[:, None, :])
        forces = np.bincount(mesh.dofs.ravel(), (mesh.volume[:, None] * np.einsum("mij,mi->mj", mesh.B, stress)).ravel(), len(u))
        local = np.einsum("mia,mij,mjb->mab", mesh.B, tangent * mesh.volume[:, None, None], mesh.B)
        matrix = sp.csr_array((local.ravel(), mesh.places), shape=(len(u), len(u)))
        return forces, matrix, (plastic + flow[:, None] * along, back + (2 / 3 * kin * flow)[:, None] * along,
                                amount + np.sqrt(2 / 3) * flow)

    @staticmethod
    def _mesh(model):
        """What does not change from one call to the next."""
        if not hasattr(model, "mesh"):
            model.mesh = _Mesh(model)
        return model.mesh


class _Mesh:
    def __init__(self, model):
        edges = model.nodes[model.cells][:, 1:] - model.nodes[model.cells][:, :1]
        self.volume, inverse = np.linalg.det(edges) / 6, np.linalg.inv(edges)
        gradient = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)  # (m, 3, 4)
        self.B = np.zeros((len(model.cells), 6, 4, 3))
        for i in range(3):
            self.B[:, i, :, i] = gradient[:, i]
        for row, (i, j) in enumerate(((0, 1), (1, 2), (0, 2)), 3):
            self.B[:, row, :, i], self.B[:, row, :, j] = gradient[:, j], gradient[:, i]
        self.B = self.B.reshape(len(model.cells), 6, 12)
        self.dofs = (3 * model.cells[:, :, None] + np.arange(3)).reshape(-1, 12)
        self.places = np.repeat(self.dofs, 12, axis=1).ravel(), np.tile(self.dofs, (1, 12)).ravel()
