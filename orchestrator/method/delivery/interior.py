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
from orchestrator.method.delivery.recovery import Parts, repositioned
from orchestrator.method.iterated import Iterated
from orchestrator.scene.congruence import first_congruent

TOGETHER = 32  # subdomains of one shape whose products are formed at once: their strains are many numbers
UNBALANCED, REPEATED = 1e-13, 1e-11  # of the largest displacement: rounding of a product, of combined back-substitutions


@dataclass(frozen=True)
class Interior:
    """Of all ranks; (T, subdomains) each, force × length."""

    energy: np.ndarray  # ‖u‖²_K
    unbalanced: np.ndarray  # ‖r‖², less rounding
    repeated: np.ndarray  # ‖δ‖², less rounding
    complete: bool  # whether the matter of all subdomains is the scene's

    def shares(self, size: float) -> tuple[float, float]:
        """√ of what is unbalanced, and of what is repeated otherwise, over all subdomains, relative to the energy norm of an answer."""
        return tuple(float(np.sqrt(x.sum(axis=1).max(initial=0.0)) / size) if size > 0 else 0.0
                     for x in (self.unbalanced, self.repeated))

    def worst(self) -> int:
        """The subdomain where most is unbalanced or repeated otherwise."""
        return int(np.argmax((self.unbalanced + self.repeated).max(axis=0)))


def interior(d: Decomposition, iterated: Iterated, parts: Parts) -> Interior:
    """Judge recovered displacements."""
    scene, steps, own = d.scene, d.scene.steps, d.own
    energy, unbalanced, repeated = np.zeros((3, steps, len(scene.subdomains)))
    forces, rigid = d.space.loads(iterated.fields.f), repositioned(d, iterated.bound)
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])
    judged = [e for e, s in enumerate(own) if not d.blackbox.traits(s.code).own_matter]
    keys = ((own[e].connectivity.tobytes(), own[e].material.tobytes()) for e in judged)
    alike: dict[int, list[int]] = {}  # those that differ by a translation alone: the first → all of them
    for e, first in zip(judged, first_congruent(keys, [scene.mesh.nodes[own[e].nodes] for e in judged])):
        alike.setdefault(judged[first], []).append(e)
    for first, all_of_them in alike.items():
        one = own[first]
        matter = Matter(scene.mesh.nodes[one.nodes], one.connectivity, *moduli[one.material].T)
        root = np.sqrt(np.repeat(matter.stiff, 3))
        for begin in range(0, len(all_of_them), TOGETHER):
            members = all_of_them[begin : begin + TOGETHER]
            together = [parts[own[e].index].reshape(steps, -1) for e in members]
            for e, u, resisting in zip(members, together, np.split(matter.forces(np.vstack(together)), len(members))):
                s, part, trace = own[e], d.space.boundary[e], d.made.traces[e]
                load = s.loads.reshape(steps, -1).copy()
                load[:, trace] += forces[:, part]
                largest = (root * np.abs(u)).max(axis=1, keepdims=True)
                left = np.where(s.fixed.ravel(), 0.0, np.abs(resisting - load) / root)
                apart = root[trace] * np.abs(u[:, trace] - rigid[e][:, trace] - iterated.fields.u[:, part])
                energy[:, s.index] = np.sum(u * resisting, axis=1)
                unbalanced[:, s.index] = np.sum(np.maximum(left - UNBALANCED * largest, 0.0) ** 2, axis=1)
                repeated[:, s.index] = np.sum(np.maximum(apart - REPEATED * largest, 0.0) ** 2, axis=1)
    energy, unbalanced, repeated, foreign = d.space.team.sum(energy, unbalanced, repeated, len(own) - len(judged))
    return Interior(energy, unbalanced, repeated, not foreign)
