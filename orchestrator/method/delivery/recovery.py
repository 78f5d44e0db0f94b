"""Delivered fields: the kinematically admissible displacement u_D that the bound speaks of, reactions."""

from __future__ import annotations

import numpy as np

from orchestrator.method.stopping.bound import Bound
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.decomposition import Decomposition
from orchestrator.scene.model import Scene


def recover(d: Decomposition, fields: Admissible, bound: Bound) -> tuple[list[np.ndarray | None], list[np.ndarray | None]]:
    """Displacement of each subdomain of this rank, None for others.

    Returns
    -------
    continuous : per subdomain of the scene (T, n_E, 3) u_D, continuous over perfect interfaces
    parts : the same before averaging, in equilibrium with their interface forces

    Notes
    -----
    One back-substitution per subdomain and load step for the fields inside the subdomains.
    """
    steps = d.steps
    robin = d.space.loads(d.stage.robin_force(fields.s, fields.alpha))
    requests = {}
    for e, (trace, forces) in enumerate(zip(d.made.traces, d.loading.forces)):
        full = np.zeros((steps, 3 * d.made.node_counts[e]))
        full[:, : forces.shape[1]] = forces
        full[:, trace] += robin[:, d.space.boundary[e]]
        if full.any():
            requests[e] = full
    answers = d.blackbox.fields(requests)
    parts, mode = [None] * len(d.scene.subdomains), 0
    for e, s in enumerate(d.own):
        size = 3 * len(s.nodes)
        u = d.loading.lift[e] + (answers[e][:, :size] if e in answers else 0.0)
        count = d.made.modes[e].shape[1]
        u = u + bound.repositioned[:, mode : mode + count] @ d.made.modes[e].T
        mode += count
        parts[s.index] = u.reshape(steps, -1, 3)
    return delivered(d, bound, parts), parts


def delivered(d: Decomposition, bound: Bound, parts: list) -> list:
    """Per subdomain (T, n_E, 3) its own displacement, continuous over perfect interfaces; None where not this rank's.

    Parameters
    ----------
    parts : as recovered
    """
    result = [None] * len(parts)
    for e, s in enumerate(d.own):
        part = parts[s.index]
        own = part.reshape(len(part), -1).copy()
        own[:, d.made.traces[e]] += bound.correction[:, d.space.boundary[e]]
        result[s.index] = own.reshape(part.shape)
    return result


def of_all(d: Decomposition, own: list) -> list:
    """Something per subdomain of the scene: of all on rank 0, elsewhere as given, None for other ranks'."""
    team = d.space.team
    if team.size == 1:
        return own
    everything = list(own)
    for things in team.gather({e: own[e] for e in d.space.subdomains}) or ():
        for e, thing in things.items():
            everything[e] = thing
    return everything


def on_mesh(scene: Scene, everyone: list[np.ndarray]) -> np.ndarray:
    """(T, n, 3) on the nodes of the mesh, from the subdomains' own (T, n_E, 3), where these are continuous.

    Parameters
    ----------
    scene : the whole one
    """
    displacement = np.zeros((everyone[0].shape[0], len(scene.mesh.nodes), 3))
    for s, u in zip(scene.subdomains, everyone):
        displacement[:, s.nodes] = u
    return displacement


def support_forces(d: Decomposition, parts: list[np.ndarray], f: np.ndarray) -> list[np.ndarray | None]:
    """Per own subdomain (T, n_E, 3) what the supports exert on its nodes: K u less the loads and the interfaces' forces.

    None where nothing is prescribed. Parameters as of ``reactions``.

    Notes
    -----
    Prescribed corners take half of what tied mid-edge nodes beside them need, see ``ties``.
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


def reactions(d: Decomposition, parts: list[np.ndarray], f: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Resultant force and moment on each boundary entry, (entries, T, 6).

    Parameters
    ----------
    parts : per subdomain (T, n_E, 3), as recovered
    f : (T, D) interface forces
    about : (3,) what moments are about

    Returns
    -------
    per entry of the YAML and step the force, then the moment: the support's reaction for prescribed
    displacements (a node in several entries counts for the last), the applied resultant for loads
    """
    scene, steps = d.scene, d.scene.steps
    supported = np.zeros((steps, len(scene.boundary), 6))
    for s, forces in zip(d.own, support_forces(d, parts, f)):
        if forces is None:
            continue
        arm = scene.mesh.nodes[s.nodes] - about
        for c in range(3):
            held = np.flatnonzero(s.fixed[:, c] & (s.held_by[:, c] >= 0))  # others are held inside a part of another program's
            entry, push = s.held_by[held, c], forces[:, held, c]
            np.add.at(supported[:, :, c], (slice(None), entry), push)
            for axis, lever, sign in ((3 + (c + 1) % 3, (c + 2) % 3, 1), (3 + (c + 2) % 3, (c + 1) % 3, -1)):  # arm × e_c
                np.add.at(supported[:, :, axis], (slice(None), entry), sign * push * arm[held, lever])
    for entry in scene.boundary:  # every face is on one rank
        if entry.forces:
            supported[:, entry.index] = entry.forces.resultant(scene.mesh.nodes[entry.triangles], about)
    total, = d.space.team.sum(supported)
    return total.swapaxes(0, 1)
