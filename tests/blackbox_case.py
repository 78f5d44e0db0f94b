"""Small models for the black box, and an assembly of their stiffness that owes FreeFEM nothing."""

from itertools import permutations

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.protocol import Model
from orchestrator.config.blackbox import CodeSettings
from orchestrator.config.load import settings_from


def settings(**changes) -> CodeSettings:
    """The ``blackbox`` section of a configuration: FreeFEM, one worker, if not told otherwise."""
    return settings_from({"workers": 1, "timeout": 60.0, **changes})


def box(cells=(3, 2, 2), name="box", seed=0, hold=True) -> Model:
    """A distorted box of six tets a cell, two materials; x = 0 held, y and z each held at part of x = 1."""
    nx, ny, nz = cells
    index = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    corners = np.stack(np.meshgrid(*[np.arange(k + 1) for k in cells], indexing="ij"), -1).reshape(-1, 3)
    nodes = corners * [0.3, 0.4, 0.5] + np.random.default_rng(seed).uniform(-0.05, 0.05, (len(corners), 3))
    i, j, k = (a.ravel() for a in np.meshgrid(*[np.arange(c) for c in cells], indexing="ij"))
    tets = []
    for order in permutations(range(3)):
        walk = [np.zeros(3, int)]
        for axis in order:
            walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
        tet = np.stack([index[i + w[0], j + w[1], k + w[2]] for w in walk], 1)
        odd = np.linalg.det(np.array(walk[1:])) < 0
        tets.append(tet[:, [0, 2, 1, 3]] if odd else tet)
    tets = np.concatenate(tets)
    fixed = np.zeros((len(nodes), 3), bool)
    if hold:
        fixed[corners[:, 0] == 0] = True
        fixed[(corners[:, 0] == nx) & (corners[:, 1] == 0), 1] = True  # a component along an edge
        fixed[index[nx, ny, nz], 2] = True  # a component at a lone node
    free = np.flatnonzero(~fixed)
    trace = np.random.default_rng(seed + 1).permutation(free)[: len(free) // 2]
    region = (np.arange(len(tets)) % 3 == 0).astype(int)
    return Model(name, nodes, tets, region, np.array([[200e3, 0.3], [70e3, 0.2]]), fixed, trace)


def chain(nodes: int) -> Model:
    """A helix of tets with any number of nodes from 4 on, held at every twentieth."""
    t = np.arange(nodes) * 1.3
    x = np.stack([np.cos(t), np.sin(t), 0.3 * t], 1)
    tets = np.arange(nodes - 3)[:, None] + np.arange(4)
    d = x[tets[:, 1:]] - x[tets[:, :1]]
    tets[np.linalg.det(d) < 0] = tets[np.linalg.det(d) < 0][:, [0, 2, 1, 3]]
    fixed = np.zeros((nodes, 3), bool)
    fixed[:3] = fixed[::20] = True
    trace = np.flatnonzero(~fixed)[::7]
    return Model(f"chain{nodes}", x, tets, np.zeros(len(tets), int), np.array([[1.0, 0.25]]), fixed, trace)


def assemble(model: Model) -> sp.csr_array:
    """Stiffness of linear elasticity on four-node tets, straight from the textbook."""
    x = model.nodes[model.cells]
    jacobian = x[:, 1:] - x[:, :1]
    volume = np.linalg.det(jacobian) / 6
    inner = np.linalg.inv(jacobian)  # (m, 3, 3): column a is the gradient of shape function a + 1
    gradient = np.concatenate([-inner.sum(2, keepdims=True), inner], 2)
    young, poisson = model.materials[model.region].T
    lam, mu = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
    strain = np.zeros((len(x), 6, 4, 3))
    for c in range(3):
        strain[:, c, :, c] = gradient[:, c]
    for row, (a, b) in enumerate([(0, 1), (1, 2), (2, 0)], 3):
        strain[:, row, :, a], strain[:, row, :, b] = gradient[:, b], gradient[:, a]
    strain = strain.reshape(len(x), 6, 12)
    law = np.zeros((len(x), 6, 6))
    law[:, :3, :3] = lam[:, None, None]
    law[:, range(3), range(3)] += 2 * mu[:, None]
    law[:, range(3, 6), range(3, 6)] = mu[:, None]
    local = np.einsum("mra,mrs,msb,m->mab", strain, law, strain, volume)
    dofs = (3 * model.cells[:, :, None] + np.arange(3)).reshape(len(x), 12)
    n = model.fixed.size
    rows, columns = np.repeat(dofs, 12, 1), np.tile(dofs, (1, 12))
    return sp.csr_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))


def forces(model: Model, rhs=3, seed=5) -> np.ndarray:
    """Random (rhs, t) forces on trace dofs."""
    return np.random.default_rng(seed).standard_normal((rhs, len(model.trace)))


def difference(a, b) -> float:
    """Largest difference, relative to b's largest entry."""
    return abs(a - b).max() / abs(b).max()
