"""The nodes of all subdomains, numbered one subdomain after another (shared nodes once per side); order by position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Coordinates that differ by less than this fraction of the points' extent count as equal.
SAME_POSITION = 1e-9


@dataclass(frozen=True)
class SplitNumbering:
    """Split node s is node ``nodes[s]`` of the mesh as seen by one subdomain.

    total : number of nodes of the mesh
    nodes : (N,) int, global node ids; within a subdomain ascending
    offsets : (parts + 1,) int, subdomain E has the split nodes offsets[E] … offsets[E + 1]
    keys : (N,) int, ascending, subdomain · total + node
    corners : (m, 4 or 10) int, split nodes of each tet
    """

    total: int
    nodes: np.ndarray
    offsets: np.ndarray
    keys: np.ndarray
    corners: np.ndarray

    def find(self, subdomain: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Split nodes of global nodes that belong to these subdomains."""
        return np.searchsorted(self.keys, subdomain * self.total + nodes)


def split_numbering(cells: np.ndarray, cell_subdomain: np.ndarray, total: int) -> SplitNumbering:
    """Numbers the nodes of every subdomain.

    cells : (m, 4 or 10) int
    cell_subdomain : (m,) int
    total : number of nodes of the mesh
    """
    order, parts = np.argsort(cell_subdomain, kind="stable"), int(cell_subdomain.max()) + 1
    ends = np.searchsorted(cell_subdomain, np.arange(1, parts), sorter=order)
    corners, nodes, offsets = np.empty(cells.shape, dtype=int), [], [0]
    # subdomain by subdomain: marks on nodes are several times as fast as sorting
    seen, place = np.zeros(total, dtype=bool), np.empty(total, dtype=int)
    for own in np.split(order, ends):
        its = cells[own]
        low, high = int(its.min(initial=total)), int(its.max(initial=-1)) + 1
        seen[its] = True
        nodes.append(low + np.flatnonzero(seen[low:high]))
        offsets.append(offsets[-1] + len(nodes[-1]))
        seen[nodes[-1]] = False
        place[nodes[-1]] = np.arange(*offsets[-2:])
        corners[own] = place[its]
    nodes, offsets = np.concatenate(nodes), np.array(offsets)
    return SplitNumbering(total, nodes, offsets, np.repeat(np.arange(parts) * np.int64(total), np.diff(offsets)) + nodes, corners)


def position_rank(points: np.ndarray) -> np.ndarray:
    """(n,) int, rank of each point in the order of x, then y, then z, blind to rounding and to units."""
    rank = np.empty(len(points), dtype=int)
    rank[np.lexsort(rounded(points))] = np.arange(len(points))
    return rank


def rounded(points: np.ndarray) -> np.ndarray:
    """(3, n) z, y and x of points as whole numbers, blind to rounding and to units."""
    low, extent = points.min(axis=0), max(np.ptp(points, axis=0).max(), np.finfo(float).tiny)
    return np.rint((points - low).T[::-1] / extent / SAME_POSITION)
