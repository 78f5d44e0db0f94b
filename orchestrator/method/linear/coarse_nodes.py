"""Macro basis of scenes that are solved by nodes: rigid motions about coarse nodes.

Nodes that the same subdomains share are a class: a face, an edge, a vertex. *Maximal* classes,
whose subdomains are not all among those of another, are the coarse nodes: at cubes the vertices, at
slices the faces. A class moves with the coarse nodes whose subdomains include all of its own, each
with a share that falls with the distance; shares add up to one, so that every rigid motion of all
is among the fields, and each field is one and the same on all sides:

    Φ = share × motion about the coarse node,   share = (1/distance) / Σ (1/distance)

Irregular parts meet in many vertices: those of three subdomains or more that are in one cell of a
grid, of a subdomain's size, are merged. Slices must not merge, whose classes have two.

Stiff islands that a border cuts (``scene.soles.overlap``) are classes of their own, which belong to
no other: each is a coarse node, and moves rigidly with it.

Reduced coarse spaces of generalised Dryja–Smith–Widlund methods are of this kind: Dohrmann &
Widlund, SIAM J. Sci. Comput. 39 (2017).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.rows import narrow, unit_rows
from orchestrator.method.interface.traces import TraceSpace
from orchestrator.parallel.team import Team
from orchestrator.scene.conditions.rigid import motions_about
from orchestrator.scene.mesh.faces import runs
from orchestrator.scene.model import Scene
from orchestrator.scene.soles.overlap import islands

# Size of the grid's cells over a subdomain's. Iterations, back-substitutions at set-up, in all; 64
# METIS parts, 206,763 dofs: nothing merged 25, 55, 100; .5 27, 39, 89; .7 29, 32, 80; .9 30, 25,
# 75.
MERGED = 0.9
NEAR = 1e-6  # of a subdomain's size: what is nearer is as near


def coarse_fields(scene: Scene, space: TraceSpace) -> tuple[sp.csr_array, np.ndarray, int]:
    """Return Φ (B, c) on the boundary dofs, of motions about coarse nodes (c,) int, ascending, and
    of how many on all ranks, which ask together."""
    nodes, of = np.unique(space.global_dof // 3, return_inverse=True)
    x, size = scene.mesh.nodes[nodes], float(scene.sizes.mean())
    centres, shares = _shares(x, *_classes(scene, nodes), size, space.team)
    counts = np.diff(shares.indptr)[of]
    dof, entry = np.repeat(np.arange(len(of)), counts), runs(shares.indptr[of], counts)
    at = shares.indices[entry]
    motions = motions_about(x[of[dof]] - centres[at], np.zeros(3), size)
    values = shares.data[entry, None] * motions[np.arange(len(dof)), space.global_dof[dof] % 3]
    seen, place = np.unique(at, return_inverse=True)
    width = values.shape[1]
    columns = width * place.reshape(-1, 1) + np.arange(width)
    fields = sp.csr_array((values.ravel(), (np.repeat(dof, width), columns.ravel())),
                          shape=(len(of), width * len(seen)))
    fields.eliminate_zeros()
    return narrow(fields), np.repeat(seen, width), len(centres)


def _classes(scene: Scene, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, sp.csr_array]:
    """Names (classes,) of the classes of shared nodes (n,), the same on all ranks; the class (n,)
    int of each node; and (classes, subdomains and islands) whose it is. A rank's part of a scene
    has all elements around its nodes."""
    island = islands(scene)[nodes]
    others = sp.diags_array(1.0 * (island < 0)) @ scene.shared[nodes]
    own = unit_rows(island, island.max(initial=-1) + 1)
    members = sp.csr_array(sp.hstack([others, own]))
    members.eliminate_zeros()
    sign = np.random.default_rng(0).integers(1, 2**63, members.shape[1], dtype=np.uint64)
    names = np.add.reduceat(sign[members.indices], members.indptr[:-1]) if len(nodes) else sign[:0]
    names, first, label = np.unique(names, return_index=True, return_inverse=True)
    return names, label, members[first]


def _shares(x: np.ndarray, names: np.ndarray, label: np.ndarray, members: sp.csr_array, size: float,
            team: Team) -> tuple[np.ndarray, sp.csr_array]:
    """Centres (c, 3) of all coarse nodes, and shares (n, c) of nodes x (n, 3) in them.

    names, label, members : their classes; size : of a subdomain, a length
    """
    many, both = members.sum(axis=1), (members @ members.T).tocoo()
    one, two = both.coords
    more = (both.data == many[one]) & (many[two] > many[one])  # all of its subdomains, and others
    above = sp.csr_array((np.ones(more.sum()), (one[more], two[more])), shape=both.shape)
    top = np.flatnonzero(np.diff(above.indptr) == 0)
    middle = np.stack([np.bincount(label, c) / np.bincount(label) for c in x.T], axis=1)
    told = zip(*team.all_gather((names[top], many[top], middle[top])))
    everyone, several, points = (np.concatenate(same) for same in told)
    everyone, first = np.unique(everyone, return_index=True)
    merged, centres = _merged(points[first], several[first] > 2, MERGED * size)
    anchors = top, merged[np.searchsorted(everyone, names[top])]
    anchor = sp.csr_array((np.ones(len(top)), anchors), shape=(len(names), len(centres)))
    near = ((above @ anchor + anchor) > 0)[label].tocoo()
    node, at = near.coords
    weight = 1 / np.maximum(np.linalg.norm(x[node] - centres[at], axis=1), NEAR * size)
    shares = sp.csr_array((weight, (node, at)), shape=near.shape)
    return centres, sp.csr_array(sp.diags_array(1 / shares.sum(axis=1)) @ shares)


def _merged(points: np.ndarray, may: np.ndarray, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """The coarse node (k,) int of each of some points (k, 3), and where these are (c, 3): points
    that ``may``, (k,) bool, are merged where they are in the same cell of a grid."""
    cell = np.round((points - points.min(axis=0)) / distance)
    key = np.column_stack([cell, np.where(may, -1, np.arange(len(points)))])
    _, label, many = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    label = label.ravel()
    return label, np.stack([np.bincount(label, c) / many for c in points.T], axis=1)
