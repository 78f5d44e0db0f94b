"""Which of the slave's nodes carry a point, and who takes the share of the others.

A node carries none where a component of it is prescribed, or where it follows the point of a rigid surface or stands on a
ground that holds it (a multiplier there would meet nothing, or pin the master), where
several interfaces that do not match meet (their constraints would be redundant), and where the master covers little of the
facets around (the point would carry a large pressure on a small area). Its multiplier goes in equal parts to the points
next to it, so that no area and no force is lost.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

# Share of the facets around a node that the master has to cover. Measured with a punch on a wider slab: from .2 the largest
# pressure is that of the punch as slave, below it grows.
COVERED = 0.2


def merged(candidates: np.ndarray, wanted: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, sp.csr_array]:
    """The points, and how the multipliers of all nodes are added up to theirs.

    candidates : (n,) bool, nodes that have a multiplier
    wanted : (n,) bool, those that may carry a point
    triangles : (k, 3) int, the corners of the facets
    Returns points : (p,) int, ascending; none where no node may carry one
    sums : (p, n) each column sums to 1 where there is a multiplier; the identity where nothing is merged
    """
    count = len(candidates)
    wanted = wanted & candidates
    points = np.flatnonzero(wanted)
    place = np.cumsum(wanted) - 1
    sums = sp.csr_array((np.ones(len(points)), (place[points], points)), shape=(len(points), count))
    left = candidates & ~wanted
    if not left.any() or not len(points):
        return points, sums
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    beside = sp.csr_array((np.ones(len(ends)), ends.T), shape=(count, count))
    beside.data[:] = 1.0  # however many facets have the edge
    known = wanted
    while left.any():
        near = sp.csr_array(beside[np.flatnonzero(left)] * known[None, :])
        near.eliminate_zeros()
        degree = np.diff(near.indptr)
        if not degree.any():  # a piece of the surface without any point: to the first of all points, rather than lost
            break
        found = np.flatnonzero(left)[degree > 0]
        shares = sp.csr_array(sp.diags_array(1 / degree[degree > 0]) @ near[degree > 0])
        given = sp.csr_array(shares @ sums.T).tocoo()  # (found, p)
        sums = sums + sp.csr_array((given.data, (given.col, found[given.row])), shape=sums.shape)
        known = known.copy()
        known[found], left[found] = True, False
    return points, sp.csr_array(sums)
