"""Soles of whole subdomains: every outside element that touches one, once, clamped behind.

Where all sides are bonded and share their nodes, a subdomain is surrounded by the elements of its
neighbours, those that it meets in an edge or in a single node included. A copy of this ring, at
half its modulus, is the subdomain's sole: plain matter of the scene, so that what is factorised is
an ordinary mesh. A sole that follows the facets leaves out the stiff elements of diagonal
neighbours, which moduli that vary at random punish.

A nearly incompressible ring, clamped behind, resists by its bulk modulus what the outside, free to
flow, resists by its shear modulus. Between two such ends the geometric mean is the best search
direction, λ' = √(λ μ), of a modulus that falls as √(h/H): the stiffest motions feel the ring's
thickness h, the softest the subdomain's size H. With n nodes in a subdomain that is n^(−1/6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.model import Scene
from orchestrator.scene.soles import Sole

INCOMPRESSIBLE = 0.49  # Poisson's ratio from which matter counts as nearly incompressible
# Nodes of a subdomain whose ring has as much of such a modulus as of others. Iterations of 64 cubes
# of 4³, 6³, 10³ bricks, ν = .49, with twice as much whatever the size: 28, 32, 40; so 28, 30, 35;
# ν = .499, ten-node tets, 5³ bricks, 68 and 57.
LARGE = 8000


@dataclass
class Ring(Sole):
    """The sole of a whole subdomain; cells number ``nodes``, then ``points``.

    nodes : (n,) int, ascending, local nodes of the subdomain that others share
    """

    nodes: np.ndarray


def make_rings(scene: Scene, subdomains: Sequence[int], ratio: float) -> list[Ring]:
    """Return the rings of some subdomains.

    ratio : ``method.sole.modulus_ratio``
    """
    young, poisson = np.array([[m.young, m.poisson]
                               for m in scene.materials])[scene.cell_material].T
    yields = poisson >= INCOMPRESSIBLE
    poisson = np.where(yields, between(poisson), poisson)
    corners, shared, rings = scene.mesh.cells[:, :4], scene.shared, []
    rows = sp.csr_array((np.ones(corners.size), corners.ravel(), np.arange(0, corners.size + 1, 4)),
                        shape=(len(corners), shared.shape[0]))
    touching, of = sp.csc_array(rows @ shared), sp.csc_array(shared)
    for e in subdomains:
        around, inner = (np.sort(x[:, [e]].indices) for x in (touching, of))
        cells = around[scene.cell_subdomain[around] != e]
        nodes = scene.subdomains[e].nodes
        stiffer = ratio * (LARGE / len(nodes)) ** (yields[cells] / 6)
        rings.append(Ring(*clamped(scene, cells, inner), stiffer * young[cells], poisson[cells],
                          np.searchsorted(nodes, inner)))
    return rings


def clamped(scene: Scene, cells: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3) and cells (q, 4 or 10) of a sole that copies cells (q,) of a scene; all
    nodes but the inner ones (n,), ascending, are its points."""
    used, number_of = np.unique(scene.mesh.cells[cells], return_inverse=True)
    inside = np.isin(used, inner)
    number = len(inner) + np.cumsum(~inside) - 1
    number[inside] = np.searchsorted(inner, used[inside])
    return scene.mesh.nodes[used[~inside]], number[number_of].reshape(-1, scene.mesh.cells.shape[1])


def between(poisson: np.ndarray) -> np.ndarray:
    """ν' of λ' = √(λ μ), given ν > 0: with λ/μ = 2ν/(1 − 2ν), ν = (λ/μ) / (2 (λ/μ + 1))."""
    ratio = np.sqrt(np.maximum(2 * poisson / (1 - 2 * poisson), 0.0))
    return ratio / (2 * (ratio + 1))
