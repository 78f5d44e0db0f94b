"""Delivered fields: the kinematically admissible displacement u_D that the bound speaks of, reactions."""

from __future__ import annotations

import numpy as np

from orchestrator.method.stopping.bound import Bound
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.decomposition import Decomposition
from orchestrator.scene.mesh.geometry import area_vectors


def recover(d: Decomposition, fields: Admissible, bound: Bound) -> tuple[np.ndarray, list[np.ndarray]]:
    """Displacement of the whole structure, and of each subdomain before averaging.

    Returns
    -------
    displacement : (T, n, 3) u_D on the nodes of the input mesh, continuous over perfect interfaces; on rank 0
    parts : per subdomain of the scene (T, n_E, 3), in equilibrium with their interface forces; on rank 0 all, on
        the others their own, None for the rest

    Notes
    -----
    One back-substitution per subdomain and load step for the fields inside the subdomains.
    """
    scene, steps = d.scene, d.steps
    robin = d.space.loads(d.stage.robin_force(fields.s, fields.alpha))
    requests = {}
    for e, (trace, forces) in enumerate(zip(d.traces, d.loading.forces)):
        full = np.zeros((steps, 3 * d.node_counts[e]))
        full[:, : forces.shape[1]] = forces
        full[:, trace] += robin[:, d.space.boundary[e]]
        if full.any():
            requests[e] = full
    answers = d.blackbox.fields(requests)
    parts, continuous, mode = [], [], 0
    for e, s in enumerate(d.own):
        size = 3 * len(s.nodes)
        u = d.loading.lift[e] + (answers[e][:, :size] if e in answers else 0.0)
        count = d.modes[e].shape[1]
        u = u + bound.repositioned[:, mode : mode + count] @ d.modes[e].T
        mode += count
        parts.append(u.reshape(steps, -1, 3).copy())
        u[:, d.traces[e]] += bound.correction[:, d.space.boundary[e]]
        continuous.append(u.reshape(steps, -1, 3))
    parts, continuous = gathered(d, parts), gathered(d, continuous)
    displacement = np.zeros((steps, len(scene.mesh.nodes), 3))
    for s, u in zip(scene.subdomains, continuous):
        if u is not None:
            displacement[:, s.nodes] = u
    return displacement, parts


def delivered(d: Decomposition, bound: Bound, parts: list) -> list:
    """Per subdomain (T, n_E, 3) its own displacement, continuous over perfect interfaces.

    Parameters
    ----------
    parts : as recovered, None where not known
    """
    result = []
    for e, s in enumerate(d.own):
        part = parts[s.index]
        own = part.reshape(len(part), -1).copy()
        own[:, d.traces[e]] += bound.correction[:, d.space.boundary[e]]
        result.append(own.reshape(part.shape))
    return gathered(d, result)


def gathered(d: Decomposition, own: list) -> list:
    """Something per subdomain: of all on rank 0, of a rank's own elsewhere (None for the rest)."""
    everything = [None] * len(d.scene.subdomains)
    for subdomains, things in d.space.team.gather((d.space.subdomains, own)) or [(d.space.subdomains, own)]:
        for e, thing in zip(subdomains, things):
            everything[e] = thing
    return everything


def reactions(d: Decomposition, parts: list[np.ndarray], f: np.ndarray) -> list[list[list[float]]]:
    """Resultant force on each boundary entry, per load step.

    Parameters
    ----------
    parts : per subdomain (T, n_E, 3), as recovered
    f : (T, D) interface forces; prescribed corners take half of what tied mid-edge nodes beside them need

    Returns
    -------
    per entry of the YAML, per step, a 3-vector: the support's reaction for prescribed
    displacements (a node in several entries counts for the last), the applied resultant for loads
    """
    scene, steps = d.scene, d.scene.steps
    nodal = np.zeros((steps, len(scene.mesh.nodes), 3))
    for s, rim in zip(d.own, d.rims):
        u = parts[s.index]
        if s.fixed.any():
            internal = (rim.stiffness @ u[:, rim.nodes].reshape(steps, -1).T).T.reshape(steps, -1, 3)
            held = s.fixed[rim.nodes]
            np.add.at(nodal, (slice(None), s.nodes[rim.nodes]),
                      np.where(held, internal - s.loads[:, rim.nodes], 0.0))
    if (ties := d.space.ties) is not None:
        at, subdomain, node, component = ties.supports.T
        held = np.array([scene.subdomains[e].nodes[n] for e, n in zip(subdomain, node)], dtype=int)
        np.add.at(nodal, (slice(None), held, component), 0.5 * f[:, ties.dofs[at]])
    owner = np.full(len(scene.mesh.nodes) * 3, -1).reshape(-1, 3)
    for entry in scene.boundary:
        if entry.kind == "displacement":
            owner[np.ix_(entry.nodes, np.flatnonzero(entry.fixed))] = entry.index
    result = []
    for entry in scene.boundary:
        if entry.kind == "displacement":
            total, = d.space.team.sum(np.where(owner == entry.index, nodal, 0.0).sum(axis=1))
        else:
            area = area_vectors(scene.mesh.nodes, entry.triangles)
            if entry.kind == "pressure":
                total = -entry.values[:, :1] * area.sum(axis=0)
            else:
                total = entry.values * np.linalg.norm(area, axis=1).sum()
        result.append(total.tolist())
    return result
