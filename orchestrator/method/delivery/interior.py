"""Recovered fields seen from the inside: what every tet of the bodies says, by the scene's own mesh and moduli.

Per subdomain and load step, with K u element by element, d the nodes' own stiffness and u_Γ what the iterations claim on
the interfaces:

    ‖u‖²_K = uᵀK u,    ‖r‖² = Σ (K u − p − Nᵀf)² / d on free dofs,    ‖δ‖² = Σ d (N u − u_Γ)²

A dof that is off by e costs at least d e² in ‖r‖²: the energy of that error, first order, where the energy itself sees it
in second order alone. Subdomains whose matter is their code's own are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orchestrator.blackbox.models.matter import Matter
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.iterated import Iterated

UNBALANCED, REPEATED = 1e-13, 1e-11  # of the largest displacement: rounding of a product, of combined back-substitutions


@dataclass(frozen=True)
class Interior:
    """Of all ranks; (T, subdomains) each, force × length.

    Parameters
    ----------
    energy : ‖u‖²_K
    unbalanced : ‖r‖², less rounding
    repeated : ‖δ‖², less rounding
    complete : whether the matter of all subdomains is the scene's
    """

    energy: np.ndarray
    unbalanced: np.ndarray
    repeated: np.ndarray
    complete: bool

    def shares(self, size: float) -> tuple[float, float]:
        """√ of what is unbalanced, and of what is repeated otherwise, over all subdomains, relative to an energy."""
        return tuple(float(np.sqrt(x.sum(axis=1).max(initial=0.0) / size)) if size > 0 else 0.0
                     for x in (self.unbalanced, self.repeated))

    def worst(self) -> int:
        """The subdomain where most is unbalanced or repeated otherwise."""
        return int(np.argmax((self.unbalanced + self.repeated).max(axis=0)))


def interior(d: Decomposition, iterated: Iterated, parts: list[np.ndarray]) -> Interior:
    """Judge recovered displacements.

    Parameters
    ----------
    parts : per subdomain (T, n_E, 3), as recovered
    """
    scene, steps = d.scene, d.scene.steps
    energy, unbalanced, repeated = np.zeros((3, steps, len(scene.subdomains)))
    forces, mode, foreign = d.space.loads(iterated.fields.f), 0, 0
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])
    for s, modes, part, trace in zip(d.own, d.modes, d.space.boundary, d.traces):
        u = parts[s.index].reshape(steps, -1)
        rigid = iterated.bound.repositioned[:, mode : mode + modes.shape[1]] @ modes.T
        mode += modes.shape[1]
        if d.blackbox.traits(s.code).own_matter:
            foreign += 1
            continue
        matter = Matter(scene.mesh.nodes[s.nodes], s.connectivity, *moduli[s.material].T)
        held, root = matter.forces(u), np.sqrt(np.repeat(matter.stiff, 3))
        load = s.loads.reshape(steps, -1).copy()
        load[:, trace] += forces[:, part]
        largest = (root * np.abs(u)).max(axis=1, keepdims=True)
        left = np.where(s.fixed.ravel(), 0.0, np.abs(held - load) / root)
        apart = root[trace] * np.abs(u[:, trace] - rigid[:, trace] - iterated.fields.u[:, part])
        energy[:, s.index] = np.sum(u * held, axis=1)
        unbalanced[:, s.index] = np.sum(np.maximum(left - UNBALANCED * largest, 0.0) ** 2, axis=1)
        repeated[:, s.index] = np.sum(np.maximum(apart - REPEATED * largest, 0.0) ** 2, axis=1)
    energy, unbalanced, repeated, foreign = d.space.team.sum(energy, unbalanced, repeated, np.array(foreign))
    return Interior(energy, unbalanced, repeated, not foreign)
