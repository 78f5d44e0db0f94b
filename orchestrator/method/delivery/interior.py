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
from orchestrator.scene.congruence import first_congruent

TOGETHER = 32  # subdomains of one shape whose products are formed at once: their strains are many numbers
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
        """√ of what is unbalanced, and of what is repeated otherwise, over all subdomains, relative to the energy norm of an answer."""
        return tuple(float(np.sqrt(x.sum(axis=1).max(initial=0.0)) / size) if size > 0 else 0.0
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
    forces = d.space.loads(iterated.fields.f)
    moduli = np.array([[m.young, m.poisson] for m in scene.materials])
    ends = np.cumsum([0] + [modes.shape[1] for modes in d.made.modes])
    own = d.own
    judged = [e for e, s in enumerate(own) if not d.blackbox.traits(s.code).own_matter]
    known: dict[int, Matter] = {}
    for kind, members in ((kind, alike[a : a + TOGETHER]) for kind, alike in _alike(d, judged).items()
                          for a in range(0, len(alike), TOGETHER)):
        one = own[kind]
        if kind not in known:
            known = {kind: Matter(scene.mesh.nodes[one.nodes], one.connectivity, *moduli[one.material].T)}
        matter = known[kind]
        root = np.sqrt(np.repeat(matter.stiff, 3))
        together = np.vstack([parts[own[e].index].reshape(steps, -1) for e in members])
        resisting = np.split(matter.forces(together), len(members))
        for e, u, held in zip(members, np.split(together, len(members)), resisting):
            s, part, trace = own[e], d.space.boundary[e], d.made.traces[e]
            rigid = iterated.bound.repositioned[:, ends[e] : ends[e + 1]] @ d.made.modes[e][trace].T
            load = s.loads.reshape(steps, -1).copy()
            load[:, trace] += forces[:, part]
            largest = (root * np.abs(u)).max(axis=1, keepdims=True)
            left = np.where(s.fixed.ravel(), 0.0, np.abs(held - load) / root)
            apart = root[trace] * np.abs(u[:, trace] - rigid - iterated.fields.u[:, part])
            energy[:, s.index] = np.sum(u * held, axis=1)
            unbalanced[:, s.index] = np.sum(np.maximum(left - UNBALANCED * largest, 0.0) ** 2, axis=1)
            repeated[:, s.index] = np.sum(np.maximum(apart - REPEATED * largest, 0.0) ** 2, axis=1)
    foreign = len(own) - len(judged)
    energy, unbalanced, repeated, foreign = d.space.team.sum(energy, unbalanced, repeated, np.array(foreign))
    return Interior(energy, unbalanced, repeated, not foreign)


def _alike(d: Decomposition, judged: list[int]) -> dict[int, list[int]]:
    """Of these subdomains, those that differ by a translation alone: the first → all of them."""
    everything = d.own
    own = [everything[e] for e in judged]
    keys = ((s.connectivity.tobytes(), s.material.tobytes()) for s in own)
    found: dict[int, list[int]] = {}
    for e, first in zip(judged, first_congruent(keys, [d.scene.mesh.nodes[s.nodes] for s in own])):
        found.setdefault(judged[first], []).append(e)
    return found
