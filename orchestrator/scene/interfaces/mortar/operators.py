"""What an interface carries whose sides are meshed each on its own: its points and two transfer operators.

Side 1 is the slave: it carries the points, with their law, normal, gap and history. Side 2 is the master. With the
traces w₁, w₂ of either side and the forces q of the points (on side 1; −q on side 2),

    d = G₂ w₂ − G₁ w₁,      f₁ = G₁ᵀ q,      f₂ = −G₂ᵀ q,      pressure = −n·q / area

All rows of both operators sum to 1 per component, and G₁ x₁ = G₂ x₂ on plane faces that touch. Where the faces are apart
or curved a rigid link carries each point from the master, so that rigid motions open nothing and the moments of both
sides are opposite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # the scene's model is there without it
    import scipy.sparse as sp


@dataclass(frozen=True)
class Mortar:
    """Points and transfer operators of an interface whose nodes do not match; p points, n₁ slave and n₂ master nodes.

    Slave and master nodes are those of ``Interface.nodes``, which then are no pairs: (n₁,) local nodes of side 1 and
    (n₂,) of side 2, all of those that carry something and no others. Columns are numbered 3 × node + component, rows
    3 × point + component.

    points : (p,) int, ascending, which of the slave nodes carry a point. The others are prescribed, lie on several
        such interfaces or are hardly covered; their share of the force goes to neighbours
    first, second : G₁ (3p, 3n₁) and G₂ (3p, 3n₂), sparse. Columns of prescribed components are there: times what is
        prescribed, they give the known part of the jump. On ten-node faces whose traces are linear, columns belong to
        corners, in the basis of ``ties``; mid-edge nodes have none. On ten-node faces that are, they belong to the nodes
        as they are
    area : (p,) that each point stands for; they sum to the area that the sides have in common
    normal : (p, 3) unit, from side 1 to side 2
    gap : (p,) distance of the sides along it as they are meshed, negative inside each other; whether it counts is the
        law's business
    triangles : (k₂, 3 or 6) int, the master's facets, indices into its nodes, the corners first; turned to look from
        side 1 to side 2, as those of the slave in ``Interface.triangles`` do
    cells : (k₂, 2) int, global cells behind each of these: the one opposite in side 1, and its own in side 2
    free : (n₂, 3) bool, components of the master's nodes that nothing prescribes; ``Interface.free`` has the slave's
    hats : (3n₁, 3p) sparse, displacements of the slave's nodes when one component of one point moves by 1: of its own node
        alone, or, on quadratic ten-node faces, along its linear function, by half in the middle of edges
    """

    points: np.ndarray
    first: sp.csr_array
    second: sp.csr_array
    area: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    triangles: np.ndarray
    cells: np.ndarray
    free: np.ndarray
    hats: sp.csr_array

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def own(self) -> sp.csr_array:
        """(3p, 3p) G₁ times ``hats``: forces f₁ = G₁ᵀ q come from q = own⁻ᵀ hatsᵀ f₁.

        Diagonal, and the identity where no neighbour has been merged; on quadratic ten-node faces a mass matrix of
        P1 functions, which conditions well.
        """
        return (self.first @ self.hats).tocsr()

    @cached_property
    def dofs(self) -> np.ndarray:
        """(3p,) columns of G₁ that belong to the points' own nodes."""
        return (3 * self.points[:, None] + np.arange(3)).ravel()

    @property
    def carrying(self) -> np.ndarray:
        """(p,) bool, points that carry something: not those of sides that slide on whose nodes the master does not reach now."""
        return self.area > 0

    @property
    def diagonal(self) -> bool:
        """Whether each point meets its own node alone, so that it can be eliminated by a division."""
        own = self.own.tocoo()
        return bool((own.row == own.col).all())
