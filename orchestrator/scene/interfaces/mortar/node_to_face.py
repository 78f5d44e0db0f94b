"""An interface whose slave is known by its nodes, and perhaps its facets: each node is carried by the master's shape functions.

    w₂ = P w₁ at the slave's nodes, P the master's functions there,      f₂ = −Pᵀ f₁

which is what ``*TIE`` of CalculiX does. No integral is taken, so that neither side need have facets that we can integrate over
(quadrilaterals, serendipity), the slave none at all; rigid motions and linear fields pass, and resultants and moments are
opposite, but constant stresses do so where the slave is the finer side or its nodes match alone. Between two meshes of our own
``make_mortar`` is better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.scene.interfaces.mortar.assembly import unit
from orchestrator.scene.interfaces.mortar.face import Face
from orchestrator.scene.interfaces.mortar.feet import Feet, feet
from orchestrator.scene.interfaces.mortar.link import linked
from orchestrator.scene.mesh.geometry import area_vectors

# Units in the last place of coordinates: a node this near to its foot is on it.
PLACES = 64 * np.finfo(float).eps
# Pieces of the master's facets that are dealt out among the slave's nodes are this share of the distance between these,
# and one facet has at most the square of so many.
FINE, MOST = 0.25, 64
# Of the nodes around one, the fourth is at its spacing also where two lie close: itself, and three more.
NEXT = 4


@dataclass(frozen=True)
class Carried:
    """Nodes of one side on the face of the other; all n of them, those without a foot too.

    Parameters
    ----------
    second : (3n, 3m) sparse, G₂: with the rigid link where nodes are off the face; empty rows where there is no foot
    area : (n,) that each node stands for; normal : (n, 3) unit, from the slave to the master
    gap : (n,) distance along it, negative inside the master
    feet : on the master
    """

    second: sp.csr_array
    area: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    feet: Feet


def carried(points: np.ndarray, master: Face, reach: float, slave: Face | None = None) -> Carried:
    """The slave's nodes (n, 3) on the master's face, no farther than ``reach`` from it.

    Parameters
    ----------
    slave : the face that these are the nodes of, where it is known; else areas and normals are the master's
    """
    on = feet(points, master, reach)
    offset = np.where(on.there[:, None], points - on.place, 0.0)
    offset[np.linalg.norm(offset, axis=1) <= PLACES * max(np.abs(points).max(initial=0.0), np.abs(master.points).max())] = 0.0
    at = np.flatnonzero(on.there)
    beside = sp.csr_array((np.ones(len(at)), (at, on.triangle[at])), shape=(len(points), len(master.triangles)))
    normal = -on.normal if slave is None else unit(slave.vectors)
    area = dealt_out(points, master) if slave is None else slave.areas
    return Carried(linked(on.weights, beside, offset, master.points, master.triangles), area, normal,
                   -np.einsum("ni,ni->n", normal, offset), on)


def dealt_out(points: np.ndarray, master: Face) -> np.ndarray:
    """(n,) area of the master next to each of the nodes (n, 3): in small pieces, each to the node nearest to it.

    Pieces farther from every node than nodes are from each other are beyond what the nodes stand for.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    apart = tree.query(points, k=min(NEXT, len(points)))[0][:, -1]
    corners = master.points[master.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=0.0)
    typical = float(np.median(apart)) or longest
    parts = int(np.clip(np.ceil(longest / (FINE * typical)), 1, MOST))
    i, j = np.divmod(np.arange(parts * parts), parts)
    upper = i + j >= parts  # a triangle is cut in parts² alike; those above the diagonal stand on their heads
    share = np.where(upper, np.stack([parts - i - 1 / 3, parts - j - 1 / 3]), np.stack([i + 1 / 3, j + 1 / 3])) / parts
    share = np.stack([1 - share.sum(axis=0), *share])
    middles = np.einsum("vs,tvc->tsc", share, corners).reshape(-1, 3)
    area = np.repeat(np.linalg.norm(area_vectors(master.points, master.triangles), axis=1) / parts**2, parts**2)
    far, nearest = tree.query(middles)
    kept = far <= apart[nearest]
    return np.bincount(nearest[kept], weights=area[kept], minlength=len(points))
