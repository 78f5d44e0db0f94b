"""Delivered fields: the kinematically admissible displacement u_D that the bound speaks of,
reactions, stored energy.

The recovered field is seen from the inside as well: what every tet of the bodies says, by the
scene's own mesh and moduli. Per subdomain and load step, with K u element by element, d the nodes'
own stiffness and u_Γ what the iterations claim on the interfaces:

    ‖u‖²_K = uᵀK u,    ‖r‖² = Σ (K u − p − Nᵀf)² / d on free dofs,    ‖δ‖² = Σ d (N u − u_Γ)²

A dof that is off by e costs at least d e² in ‖r‖²: the energy of that error, first order, where the
energy itself sees it in second order alone. Subdomains whose matter is their code's own are left
out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orchestrator.blackbox.models import Matter
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.interface.rows import bounds_of
from orchestrator.method.iterated import Iterated
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.scene.loads.temperature import strained_energy, thermal_loads
from orchestrator.scene.model import Scene

Parts = list[np.ndarray | None]  # per subdomain of the scene (T, n_E, 3); None for other ranks'


def recover(d: Decomposition, fields: Admissible, bound: Judged) -> tuple[Parts, Parts]:
    """u_D, continuous over perfect interfaces, and the same before averaging, in equilibrium with
    the interface forces.

    One back-substitution per subdomain and load step for the fields inside the subdomains.
    """
    parts: Parts = [None] * len(d.scene.subdomains)
    answers = answered(d, d.space.loads(d.stage.robin_of(fields)), d.loading.forces)
    for s, lift, answer, rigid in zip(d.own, d.loading.lift, answers, repositioned(d, bound)):
        parts[s.index] = (lift + answer + rigid).reshape(d.steps, -1, 3)
    return continuous(d, bound, parts), parts


def answered(d: Decomposition, boundary: np.ndarray,
             inside: Sequence[np.ndarray] | None = None) -> list[np.ndarray]:
    """Return per own subdomain (T, 3 n_E) what bodies on their soles answer to boundary forces
    (T, B), and to others ``inside``, (T, 3 n_E) each."""
    requests = {}
    for e, (trace, part) in enumerate(zip(d.made.traces, d.space.boundary)):
        forces = np.zeros((d.steps, 3 * d.made.node_counts[e]))
        if inside is not None:
            forces[:, : inside[e].shape[1]] = inside[e]
        forces[:, trace] += boundary[:, part]
        if forces.any():
            requests[e] = forces
    answers = d.blackbox.fields(requests)
    return [answers[e][:, : s.fixed.size] if e in answers else np.zeros((d.steps, s.fixed.size))
            for e, s in enumerate(d.own)]


def repositioned(d: Decomposition, bound: Judged) -> list[np.ndarray]:
    """Per own subdomain (T, 3 n_E) the rigid motion that the bound has found for it."""
    ends = bounds_of([modes.shape[1] for modes in d.made.modes])
    return [bound.repositioned[:, a:b] @ modes.T
            for modes, a, b in zip(d.made.modes, ends[:-1], ends[1:])]


def on_boundary(d: Decomposition, own: Sequence[np.ndarray], steps: int) -> np.ndarray:
    """(T, B) boundary values of displacements, per own subdomain (T, 3 n_E) or (T, n_E, 3);
    ``steps``: T, of a rank without any too.
    """
    return np.hstack(
        [np.zeros((steps, 0)),
         *(u.reshape(steps, -1)[:, trace] for u, trace in zip(own, d.made.traces))])


def continuous(d: Decomposition, bound: Judged, parts: Parts) -> Parts:
    """Recovered displacements, made continuous over perfect interfaces."""
    result: Parts = [None] * len(parts)
    for s, trace, boundary in zip(d.own, d.made.traces, d.space.boundary):
        own = parts[s.index].reshape(len(parts[s.index]), -1).copy()
        own[:, trace] += bound.correction[:, boundary]
        result[s.index] = own.reshape(parts[s.index].shape)
    return result


def of_all(d: Decomposition, own: list) -> list:
    """Something per subdomain of the scene: of all on rank 0, elsewhere as given, None for other
    ranks'.
    """
    everything = list(own)
    for things in d.space.team.gather({e: own[e] for e in d.space.subdomains}) or ():
        for e, thing in things.items():
            everything[e] = thing
    return everything


def on_mesh(scene: Scene, sides: list[np.ndarray]) -> np.ndarray:
    """(T, n, 3) on the nodes of the whole mesh the mean of their copies, from the subdomains' (T,
    n_E, 3).
    """
    total, copies = at_nodes([s.nodes for s in scene.subdomains], sides, len(scene.mesh.nodes))
    return total / np.maximum(copies, 1)[:, None]


def at_nodes(nodes: Sequence[np.ndarray], sides: Sequence[np.ndarray],
             count: int) -> tuple[np.ndarray, np.ndarray]:
    """(T, count, 3) sums at nodes of what several subdomains (T, n_E, 3) have there, and (count,)
    how many they are.

    nodes : per subdomain (n_E,) int, which ones are its
    """
    total, copies = np.zeros((len(sides[0]), count, 3)), np.zeros(count)
    for at, own in zip(nodes, sides):
        total[:, at] += own
        copies[at] += 1
    return total, copies


def support_forces(d: Decomposition, parts: Parts, f: np.ndarray,
                   taken: list[np.ndarray | None] | None = None) -> list[np.ndarray | None]:
    """Per own subdomain (T, n_E, 3) what the supports exert on its nodes: K u less the loads and
    the interfaces' forces f (T, D).

    None where nothing is prescribed.

    taken : what supports take besides, see ``lawful``
    """
    steps, space, result = d.scene.steps, d.space, []
    subdomain, dof = space.held_at.T
    pushed = f[:, space.held]
    for e, (s, rim) in enumerate(zip(d.own, d.made.rims)):
        if not s.fixed.any():
            result.append(None)
            continue
        u = parts[s.index][:, rim.nodes]
        # a shift as a whole costs no force, but would round the rest
        u = (u if s.foreign else u - u[:, :1]).reshape(steps, -1)
        forces = np.zeros((steps, len(s.nodes), 3))
        internal = (rim.stiffness @ u.T).T.reshape(steps, -1, 3)
        forces[:, rim.nodes] = np.where(s.fixed[rim.nodes], internal - s.loads[:, rim.nodes], 0.0)
        flat, mine = forces.reshape(steps, -1), subdomain == s.index
        np.subtract.at(flat, (slice(None), dof[mine]), pushed[:, mine])
        forces += 0.0 if taken is None else taken[e]
        result.append(forces)
    return result


def reactions(d: Decomposition, parts: Parts, f: np.ndarray,
              taken: list[np.ndarray | None] | None = None) -> np.ndarray:
    """(entries, T, 6) resultant force, and moment about the origin, on each boundary entry of the
    YAML.

    That of the support for prescribed displacements (a node in several entries counts for the
    last), that applied for loads.
    parts, f, taken : as for ``support_forces``
    """
    scene = d.scene
    total = np.zeros((len(scene.boundary), scene.steps, 6))
    for s, forces in zip(d.own, support_forces(d, parts, f, taken)):
        if forces is not None:
            # others are held inside a part of another program's
            for entry in np.unique(s.held_by[s.fixed & (s.held_by >= 0)]):
                total[entry] += wrench(scene.mesh.nodes[s.nodes],
                                       np.where(s.fixed & (s.held_by == entry), forces, 0.0))
    for entry in scene.boundary:  # every face is on one rank
        if entry.forces:
            total[entry.index] = entry.forces.resultant(scene.mesh.nodes[entry.triangles],
                                                        np.zeros(3))
    return d.space.team.sum(total)[0]


def wrench(points: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """(T, 6) resultant, and moment about the origin, of forces (T, n, 3) at points (n, 3)."""
    turning, y, z = np.tensordot(forces, points, axes=(1, 0)), [1, 2, 0], [2, 0, 1]
    return np.hstack([forces.sum(axis=1), turning[:, z, y] - turning[:, y, z]])


def joint_forces(d: Decomposition, f: np.ndarray) -> Parts:
    """Sums of interface forces f (T, D) at the nodes of subdomains whose mesh is not ours; None for
    others.
    """
    found, forces = [None] * len(d.scene.subdomains), d.space.loads(f)
    for s, trace, part in zip(d.own, d.made.traces, d.space.boundary):
        if s.foreign:
            own = np.zeros((len(f), 3 * len(s.nodes)))
            own[:, trace] = forces[:, part]
            found[s.index] = own.reshape(len(f), -1, 3)
    return found


def stored_energy(d: Decomposition, sides: Parts, energy: np.ndarray) -> np.ndarray:
    """(T,) ½ ∫ (ε − ε₀) : C (ε − ε₀) = ½ ‖u‖²_K − u · ∫ Bᵀ C ε₀ + ½ ∫ ε₀ : C ε₀ of all ranks; ε₀ is
    thermal strain.

    sides : per subdomain (T, n_E, 3) u; energy : (T,) ‖u‖²_K
    """
    scene = d.scene
    if scene.thermal is None:
        return 0.5 * energy
    own, starts = np.concatenate([s.cells for s in d.own]), bounds_of([len(s.nodes) for s in d.own])
    mesh, strain, at = replace(scene.mesh, cells=scene.mesh.cells[own]), scene.thermal[:, own], [
        s.connectivity + start for s, start in zip(d.own, starts)]
    forces = np.zeros((scene.steps, starts[-1], 3))
    thermal_loads(mesh, strain, scene.materials, scene.cell_material[own], np.concatenate(at),
                  forces)
    work = np.einsum("tni,tni->t", forces, np.concatenate([sides[s.index] for s in d.own], axis=1))
    return 0.5 * energy + d.space.team.sum(strained_energy(mesh, strain, scene.lame[own]) - work)[0]


# of the largest displacement: rounding of a product, of combined back-substitutions
UNBALANCED, REPEATED = 1e-13, 1e-11


@dataclass(frozen=True)
class Interior:
    """Squared norms of all ranks; (T, subdomains) each, force × length."""

    energy: np.ndarray  # ‖u‖²_K
    unbalanced: np.ndarray  # ‖r‖², less rounding
    repeated: np.ndarray  # ‖δ‖², less rounding
    complete: bool  # whether the matter of all subdomains is the scene's

    def shares(self, size: float) -> tuple[float, float]:
        """√ of what is unbalanced, and of what is repeated otherwise, over all subdomains, relative
        to the energy norm of an answer.
        """
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
    judged = [e for e, s in enumerate(own) if not d.blackbox.traits(s.code).own_matter]
    for e in judged:
        s, part, trace = own[e], d.space.boundary[e], d.made.traces[e]
        matter, u = Matter(scene.mesh.nodes[s.nodes], s.connectivity,
                           *scene.moduli[s.material].T), parts[s.index].reshape(steps, -1)
        root, resisting, load = np.sqrt(np.repeat(matter.stiff, 3)), matter.forces(
            u), s.loads.reshape(steps, -1).copy()
        load[:, trace] += forces[:, part]
        largest = (root * np.abs(u)).max(axis=1, keepdims=True)
        left = np.where(s.fixed.ravel(), 0.0, np.abs(resisting - load) / root)
        apart = root[trace] * np.abs(u[:, trace] - rigid[e][:, trace] - iterated.fields.u[:, part])
        energy[:, s.index] = np.sum(u * resisting, axis=1)
        unbalanced[:, s.index] = np.sum(np.maximum(left - UNBALANCED * largest, 0.0) ** 2, axis=1)
        repeated[:, s.index] = np.sum(np.maximum(apart - REPEATED * largest, 0.0) ** 2, axis=1)
    energy, unbalanced, repeated, foreign = d.space.team.sum(
        energy, unbalanced, repeated, len(own) - len(judged))
    return Interior(energy, unbalanced, repeated, not foreign)
