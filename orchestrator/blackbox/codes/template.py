"""Your own solver as a black box: copy this file, replace the three bodies, and name the copy in
the YAML.

    blackbox: {code: my_solver.py}            # every subdomain; the class is called Solver
    blackbox:                                 # or some of them: the last match wins
      - {code: freefem}
      - {code: my_solver.py, on: [punch]}

    orchestrator conformance my_solver.py     # does it keep the protocol?

What arrives (``Model``), in the units of the YAML:

    name        of the subdomain, for messages
    nodes       (n, 3) coordinates
    cells       (m, 4) four-node tets, positively oriented: the subdomain and the soles glued to its
                interfaces. (m, 10) where element: P2 is asked for and the class says elements =
                ("P1", "P2"): then with the nodes in the middle of the edges 01, 12, 02, 03, 13, 23
    region      (m,) row of ``materials`` for each tet
    materials   (r, 2) Young's modulus and Poisson's ratio
    fixed       (n, 3) dofs clamped to zero, among them the outer nodes of the soles
    trace       (t,) dofs on interfaces: where forces come and displacements are wanted (you need
                not look at it)
    sole        (m,) bool, tets that are soles: plain matter by their ``materials``, whatever the
                matter of yours is
    volume      (m,) row of ``volumes``, the names of the mesh's volumes, for each tet; −1 for soles
    number      (n,) number of each node in the mesh of the YAML; −1 for soles

A dof is 3 * node + component. Forces and displacements are float64, one load case per row, in the
order asked. ``stiffness`` and ``prepare`` may be called for several models and in any order. An
exception ends the run with its traceback and the subdomain's name. Your process may die or hang:
the run then ends too (``blackbox.timeout``).

Two promises of the class, both False unless it says otherwise:

    translation_invariant = True    answers depend neither on where a model is nor on its name:
                                    slices of a beam that differ by a translation are then
                                    factorised once, and share all answers
    own_matter = True               the material is yours, not ``materials``: its stiffness is then
                                    not held against that of the YAML's moduli (symmetry and rigid
                                    motions are always tested)

The bodies below work as they are: linear tets by hand, scipy for the factorisation.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla


class Solver:
    """Replace the bodies; keep names, shapes and units."""

    translation_invariant = own_matter = False

    def stiffness(self, model) -> sp.csr_array:
        """(3n, 3n) symmetric stiffness of all tets, nothing clamped.

        Called for the soles (the search direction), for the rims of the subdomains (energies,
        reactions), and once per subdomain to check what ``solve`` answers.
        """
        corners = model.nodes[model.cells]
        edges = corners[:, 1:] - corners[:, :1]
        volume = np.linalg.det(edges) / 6
        inverse = np.linalg.inv(edges)
        gradient = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse],
                                  axis=2).transpose(0, 2, 1)
        young, poisson = model.materials[model.region].T
        lam, mu = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
        # with the gradients (m, 4, 3) of the shape functions: K_aibj = V (λ ∂i φa ∂j φb + μ ∂j φa
        # ∂i φb + μ δij ∇φa·∇φb)
        outer = np.einsum("mai,mbj->maibj", gradient, gradient)
        local = (lam[:, None, None, None, None] * outer + mu[:, None, None, None, None] * (
            outer.transpose(0, 1, 4, 3, 2) + np.einsum("mabkk,ij->maibj",
                                                       outer.transpose(0, 1, 3, 2, 4), np.eye(3))))
        dofs = (3 * model.cells[:, :, None] + np.arange(3)).reshape(-1, 12)
        values = (volume[:, None] * local.reshape(-1, 144)).ravel()
        places = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
        return sp.csr_array((values, places), shape=(model.fixed.size,) * 2)

    def prepare(self, model):
        """Assemble, clamp and factorise, once per subdomain; whatever is returned comes back in
        ``solve``.
        """
        free = np.flatnonzero(~model.fixed)
        return free, spla.splu(sp.csc_array(self.stiffness(model)[free][:, free]))

    def solve(self, prepared, forces: np.ndarray) -> np.ndarray:
        """(rhs, 3n) nodal forces to (rhs, 3n) nodal displacements, zero where clamped."""
        free, factor = prepared
        displacements = np.zeros_like(forces)
        displacements[:, free] = factor.solve(np.ascontiguousarray(forces[:, free].T)).T
        return displacements
