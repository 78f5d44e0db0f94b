"""Delivered fields: the kinematically admissible displacement u_D that the bound speaks of, reactions, stored energy."""

from __future__ import annotations

import numpy as np

from orchestrator.method.decomposition import Decomposition
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.bound import Bound
from orchestrator.scene.loads.temperature import strained_energy, thermal_loads
from orchestrator.scene.model import Scene
from orchestrator.scene.mesh.mesh import split_numbering

Parts = list[np.ndarray | None]  # per subdomain of the scene (T, n_E, 3); None for other ranks'


def recover(d: Decomposition, fields: Admissible, bound: Bound) -> tuple[Parts, Parts]:
    """u_D, continuous over perfect interfaces, and the same before averaging, in equilibrium with the interface forces.

    One back-substitution per subdomain and load step for the fields inside the subdomains.
    """
    robin, requests = d.space.loads(d.stage.robin_force(fields.s, fields.alpha)), {}
    for e, (trace, forces) in enumerate(zip(d.made.traces, d.loading.forces)):
        full = np.zeros((d.steps, 3 * d.made.node_counts[e]))
        full[:, : forces.shape[1]] = forces
        full[:, trace] += robin[:, d.space.boundary[e]]
        if full.any():
            requests[e] = full
    answers = d.blackbox.fields(requests)
    parts: Parts = [None] * len(d.scene.subdomains)
    for e, (s, rigid) in enumerate(zip(d.own, repositioned(d, bound))):
        u = d.loading.lift[e] + (answers[e][:, : 3 * len(s.nodes)] if e in answers else 0.0)
        parts[s.index] = (u + rigid).reshape(d.steps, -1, 3)
    return continuous(d, bound, parts), parts


def repositioned(d: Decomposition, bound: Bound) -> list[np.ndarray]:
    """Per own subdomain (T, 3 n_E) the rigid motion that the bound has found for it."""
    ends = np.cumsum([0] + [modes.shape[1] for modes in d.made.modes])
    return [bound.repositioned[:, a:b] @ modes.T for modes, a, b in zip(d.made.modes, ends[:-1], ends[1:])]


def continuous(d: Decomposition, bound: Bound, parts: Parts) -> Parts:
    """Recovered displacements, made continuous over perfect interfaces."""
    result: Parts = [None] * len(parts)
    for s, trace, boundary in zip(d.own, d.made.traces, d.space.boundary):
        own = parts[s.index].reshape(len(parts[s.index]), -1).copy()
        own[:, trace] += bound.correction[:, boundary]
        result[s.index] = own.reshape(parts[s.index].shape)
    return result


def of_all(d: Decomposition, own: list) -> list:
    """Something per subdomain of the scene: of all on rank 0, elsewhere as given, None for other ranks'."""
    everything = list(own)
    for things in d.space.team.gather({e: own[e] for e in d.space.subdomains}) or ():
        for e, thing in things.items():
            everything[e] = thing
    return everything


def on_mesh(scene: Scene, sides: list[np.ndarray]) -> np.ndarray:
    """(T, n, 3) on the nodes of the whole mesh the mean of their copies, from the subdomains' (T, n_E, 3)."""
    total, copies = np.zeros((len(sides[0]), len(scene.mesh.nodes), 3)), np.zeros(len(scene.mesh.nodes))
    for s, own in zip(scene.subdomains, sides):
        total[:, s.nodes] += own
        copies[s.nodes] += 1
    return total / np.maximum(copies, 1)[:, None]


def support_forces(d: Decomposition, parts: Parts, f: np.ndarray) -> list[np.ndarray | None]:
    """Per own subdomain (T, n_E, 3) what the supports exert on its nodes: K u less the loads and the interfaces' forces f (T, D).

    None where nothing is prescribed. Prescribed corners take half of what tied mid-edge nodes beside them need, see ``ties``.
    """
    steps, space, result = d.scene.steps, d.space, []
    subdomain, dof = space.held_at.T
    pushed = space.at_nodes(f)[:, space.held]
    for s, rim in zip(d.own, d.made.rims):
        if not s.fixed.any():
            result.append(None)
            continue
        u = parts[s.index][:, rim.nodes].reshape(steps, -1)
        forces = np.zeros((steps, len(s.nodes), 3))
        internal = (rim.stiffness @ u.T).T.reshape(steps, -1, 3)
        forces[:, rim.nodes] = np.where(s.fixed[rim.nodes], internal - s.loads[:, rim.nodes], 0.0)
        flat, mine = forces.reshape(steps, -1), subdomain == s.index
        np.subtract.at(flat, (slice(None), dof[mine]), pushed[:, mine])
        if (ties := space.ties) is not None:
            at, _, node, component = ties.supports[ties.supports[:, 1] == s.index].T
            np.add.at(flat, (slice(None), 3 * node + component), 0.5 * f[:, ties.dofs[at]])
        result.append(forces)
    return result


def reactions(d: Decomposition, parts: Parts, f: np.ndarray) -> np.ndarray:
    """(entries, T, 6) resultant force, and moment about the origin, on each boundary entry of the YAML.

    That of the support for prescribed displacements (a node in several entries counts for the last), that applied for loads.
    """
    scene = d.scene
    total = np.zeros((scene.steps, len(scene.boundary), 6))
    for s, forces in zip(d.own, support_forces(d, parts, f)):
        if forces is None:
            continue
        arm = scene.mesh.nodes[s.nodes]
        for c in range(3):
            held = np.flatnonzero(s.fixed[:, c] & (s.held_by[:, c] >= 0))  # others are held inside a part of another program's
            entry, push = s.held_by[held, c], forces[:, held, c]
            np.add.at(total[:, :, c], (slice(None), entry), push)
            for axis, lever, sign in ((3 + (c + 1) % 3, (c + 2) % 3, 1), (3 + (c + 2) % 3, (c + 1) % 3, -1)):  # arm × e_c
                np.add.at(total[:, :, axis], (slice(None), entry), sign * push * arm[held, lever])
    for entry in scene.boundary:  # every face is on one rank
        if entry.forces:
            total[:, entry.index] = entry.forces.resultant(scene.mesh.nodes[entry.triangles], np.zeros(3))
    total, = d.space.team.sum(total)
    return total.swapaxes(0, 1)


def joint_forces(d: Decomposition, f: np.ndarray) -> Parts:
    """What interface forces f (T, D) add up to at the nodes of subdomains whose mesh is not ours; None for others."""
    found, forces = [None] * len(d.scene.subdomains), d.space.loads(f)
    for s, trace, part in zip(d.own, d.made.traces, d.space.boundary):
        if s.foreign:
            own = np.zeros((len(f), 3 * len(s.nodes)))
            own[:, trace] = forces[:, part]
            found[s.index] = own.reshape(len(f), -1, 3)
    return found


def stored_energy(scene: Scene, sides: list[np.ndarray], energy: np.ndarray) -> np.ndarray:
    """(T,) ½ ∫ (ε − ε₀) : C (ε − ε₀) = ½ ‖u‖²_K − u · ∫ Bᵀ C ε₀ + ½ ∫ ε₀ : C ε₀, on rank 0; ε₀ is thermal strain.

    sides : per subdomain (T, n_E, 3) u; energy : (T,) ‖u‖²_K
    """
    if scene.thermal is None:
        return 0.5 * energy
    numbering = split_numbering(scene.mesh.cells, scene.cell_subdomain, len(scene.mesh.nodes))
    forces = np.zeros((scene.steps, len(numbering.nodes), 3))
    thermal_loads(scene.mesh, scene.thermal, scene.materials, scene.cell_material, numbering.corners, forces)
    work = np.einsum("tni,tni->t", forces, np.concatenate(sides, axis=1))
    return 0.5 * energy - work + strained_energy(scene.mesh, scene.thermal, scene.lame)
