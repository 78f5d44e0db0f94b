"""Operators of six-node faces whose nodes are paired, under laws that say what passes from the jump or the force.

A constant traction loads the middles of a six-node face's edges, by a third each, and its corners not at all. So the points are these
middles, node against node, and a corner goes where its body takes it:

    d = u₂ − u₁ in the middle of an edge,      A n = Σ of the area vectors, a third of each, of the
    faces that meet there

Sums over the middles integrate products of linear functions exactly (Strang & Fix 1973), so that linear tractions have their resultant
and their moment. The jump's mean on every face is that of its middles, so that what tractions differ from constant ones on a face alone is
missed, O(h^(3/2)): what quadratic displacements reach beside a contact that ends (Hild & Laborde, Appl. Numer. Math. 41, 2002). Means around
corners, ∫ N d / ∫ N, would see the gap beyond that border: pressures oscillate from there inwards. And the pieces of a body that is cut
through a contact see the same gap where they meet.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.operators import Mortar, hats, only
from orchestrator.scene.interfaces.upright import mirrored
from orchestrator.scene.mesh.geometry import area_vectors, node_vectors, unit
from orchestrator.scene.mesh.quadratic import TRIANGLE_SHARES


def paired_mortar(points: np.ndarray, triangles: np.ndarray, cells: np.ndarray,
                  normals: np.ndarray | None, gap: np.ndarray,
                  fixed: tuple[np.ndarray, np.ndarray]) -> Mortar:
    """The operators; parameters as of ``Interface`` and ``Mortar``. What is prescribed on both sides has no point.

    points : (n, 3) halfway between the sides
    normals : (n, 3) of a surface at the nodes; None: of the faces; gap : (n,) distance of the sides
        at the nodes
    fixed : (n, 3) bool, components prescribed on either side
    """
    vectors, held = node_vectors(points, triangles, TRIANGLE_SHARES[6]), fixed[0] & fixed[1]
    chosen = np.flatnonzero(vectors.any(axis=1) & ~held.all(axis=1))
    normals = unit(vectors) if normals is None else normals
    upright = mirrored(normals, area_vectors(points, triangles), triangles, held)
    area = np.einsum("ni,ni->n", vectors, upright)
    picks, live = (3 * chosen[:, None] + np.arange(3)).ravel(), ~held[chosen]
    operator = only(sp.csr_array(sp.eye_array(3 * len(points), format="csr")[picks]), live)
    return Mortar(chosen, operator, operator, area[chosen], upright[chosen], gap[chosen], triangles, cells, ~fixed[1],
                  hats(chosen, triangles), live)
