"""Ten-node tets for the tests: models numbered at random, and a stiffness that owes FreeFEM nothing."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.scene.mesh.quadratic import TET_EDGES, edges_of

# Four points that integrate degree two exactly over a tet, in barycentric coordinates; equal weights.
POINTS = np.full((4, 4), (5 - np.sqrt(5)) / 20) + np.eye(4) * np.sqrt(5) / 5


def with_middles(model: Model, seed=0) -> Model:
    """A model of four-node tets with a node on every edge; all nodes renumbered at random, corners among the others."""
    ends, edge = edges_of(model.cells, TET_EDGES)
    n = len(model.nodes)
    nodes = np.vstack([model.nodes, model.nodes[ends].mean(axis=1)])
    fixed = np.vstack([model.fixed, model.fixed[ends].all(axis=1)])
    new = np.random.default_rng(seed).permutation(len(nodes))
    cells = new[np.hstack([model.cells, n + edge])]
    place = np.argsort(new)
    nodes, fixed = nodes[place], fixed[place]
    free = np.flatnonzero(~fixed)
    trace = np.random.default_rng(seed + 1).permutation(free)[: len(free) // 2]
    return replace(model, nodes=nodes, cells=cells, fixed=fixed, trace=trace)


def assemble_ten(model: Model) -> sp.csr_array:
    """Stiffness of linear elasticity on straight ten-node tets, by quadrature."""
    x = model.nodes[model.cells[:, :4]]
    jacobian = x[:, 1:] - x[:, :1]
    volume = np.linalg.det(jacobian) / 6
    inner = np.linalg.inv(jacobian)
    linear = np.concatenate([-inner.sum(2, keepdims=True), inner], 2).transpose(0, 2, 1)  # (m, 4, 3)
    young, poisson = model.materials[model.region].T
    lam, mu = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
    local = np.zeros((len(x), 10, 3, 10, 3))
    for at in POINTS:
        corner = (4 * at - 1)[:, None] * linear
        middle = [4 * (at[i] * linear[:, j] + at[j] * linear[:, i])
                  for i, j in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))]
        g = np.concatenate([corner, np.stack(middle, 1)], 1)
        weight = volume / 4
        local += np.einsum("m,mai,mbj->maibj", weight * lam, g, g)
        local += np.einsum("m,maj,mbi->maibj", weight * mu, g, g)
        local += np.einsum("m,mak,mbk,ij->maibj", weight * mu, g, g, np.eye(3))
    dofs = (3 * model.cells[:, :, None] + np.arange(3)).reshape(len(x), 30)
    n = model.fixed.size
    rows, columns = np.repeat(dofs, 30, 1), np.tile(dofs, (1, 30))
    return sp.csr_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
