"""Soles of whole subdomains: every outside element that touches one, once, clamped behind.

Where all sides are bonded and share their nodes, a subdomain is surrounded by the elements of its
neighbours, those that it meets in an edge or in a single node included. A copy of this ring, at a
share of its modulus, is the subdomain's sole: plain matter of the scene, so that what is factorised
is an ordinary mesh. A sole that follows the facets leaves out the stiff elements of diagonal
neighbours, which moduli that vary at random punish.

How stiff a ring should be depends on how far apart the ends are between which it stands: the
stiffest motions that are left to the iterations feel the element's size h, the softest the
subdomain's, H. The best of one parameter falls as √(h/H) (Gander, SIAM J. Numer. Anal. 44, 2006),
with n nodes in a subdomain as n^(−1/6).

A nearly incompressible ring, clamped behind, resists by its bulk modulus what the outside, free to
flow, resists by its shear modulus. Between two such ends the geometric mean is the best search
direction: λ' = √(λ μ), of most of the modulus.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.model import Scene
from orchestrator.scene.soles import Sole

INCOMPRESSIBLE = 0.49  # Poisson's ratio from which matter counts as nearly incompressible
# Nodes of a subdomain whose ring has ``modulus_ratio`` of the modulus. Iterations with ½ of it
# whatever the size, and so: 64 cubes of 10³ bricks, easy 20, 18, moduli 1:1000 23, 21; METIS parts
# 30, 27; a plate 31, 28; 32 slices 10, 10; 8 slices 9, 10.
SMALL = 250
# The modulus of nearly incompressible rings, over that of others. Iterations of 64 cubes of 4³ and
# 10³ bricks, ν = .49, and of ten-node tets, ν = .499, with 1.3, 1.8, 2.7: 37, 28, 28; 34, 35, 40;
# 60, 57, 68.
STIFFER = 1.8


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
    young, poisson = scene.moduli[scene.cell_material].T
    yields = poisson >= INCOMPRESSIBLE
    poisson = np.where(yields, between(poisson), poisson)
    corners, shared, rings = scene.mesh.cells[:, :4], scene.shared, []
    rows = sp.csr_array((np.ones(corners.size), corners.ravel(), np.arange(0, corners.size + 1, 4)),
                        shape=(len(corners), shared.shape[0]))
    touching, of = (np.split(x.indices, x.indptr[1:-1])
                    for x in map(sp.csc_array, (rows @ shared, shared)))
    for e in subdomains:
        around, inner = touching[e], of[e]
        cells = around[scene.cell_subdomain[around] != e]
        nodes = scene.subdomains[e].nodes
        stiff = ratio * np.where(yields[cells], STIFFER, 1.0) * (SMALL / len(nodes)) ** (1 / 6)
        rings.append(Ring(*clamped(scene, cells, inner), stiff * young[cells], poisson[cells],
                          np.searchsorted(nodes, inner)))
    return rings


def clamped(scene: Scene, cells: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (p, 3) and cells (q, 4 or 10) of a sole that copies cells (q,) of a scene; all
    nodes but the inner ones (n,), ascending, are its points."""
    copied, number = scene.mesh.cells[cells], np.empty(len(scene.mesh.nodes), dtype=int)
    outer = np.setdiff1d(copied, inner)
    number[np.concatenate([inner, outer])] = np.arange(len(inner) + len(outer))
    return scene.mesh.nodes[outer], number[copied]


def between(poisson: np.ndarray) -> np.ndarray:
    """ν' of λ' = √(λ μ), given ν > 0: with λ/μ = 2ν/(1 − 2ν), ν = (λ/μ) / (2 (λ/μ + 1))."""
    ratio = np.sqrt(np.maximum(2 * poisson / (1 - 2 * poisson), 0.0))
    return ratio / (2 * (ratio + 1))
