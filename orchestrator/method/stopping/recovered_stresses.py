"""Estimate of the discretisation error of four-node tets from recovered stresses (Zienkiewicz and
Zhu).

A nodal stress σ* is recovered from the surrounding cells' stresses and interpolated like the
displacement. It is closer to the exact stress than the finite element stress σ itself, so that
their distance estimates the error:

    η²_cell = ∫_cell (σ* − σ) : C⁻¹ (σ* − σ),     η² = Σ η²_cell

It is what a linear function has at the node x, the one nearest to the stresses of the patch, which
are those of the centroids c:

    min Σ V |σ − a − b·(c − x)|² + τ s |b|²,     σ*(x) = a,     s = Σ V |c − x|² / 3

On surfaces and interfaces all cells are on one side, and a mean would be the stress somewhere
inside. Patches that do not tell a slope, as where one cell is all there is, have a small one by τ,
and a mean.

Stresses are recovered within one matter and over perfect interfaces only: true jumps of the stress,
from one material to the next and across interfaces that open or slip, are not smoothed away and so
not taken for errors.

Nearly incompressible matter needs one thing more. Elements that lock move too little, and smoothly:
their stress deviator shows nothing. What gives them away is the pressure, which carries the loads
in their place and leaps from cell to cell; C⁻¹ divides its square by the bulk modulus K, so that
the estimate would vanish as ν goes to ½. But an error of the pressure p is never alone. Errors of
both are in balance, ∫ 2μ ε' : ε'(v) = ∫ p div v for all v, so that with β the inf-sup constant

    ∫ 2μ ε' : ε' ≥ β² ∫ p²/2μ,

and pressures are divided by the smaller of K and ``SOFTEST`` μ. Below ν = 0.385 that is K. Measured
against much finer solutions (bending, tension and compression of blocks between plates, a loaded
corner; four- and ten-node tets) the estimate then is 0.7 to 1.6 times the truth up to ν = 0.49,
from there 0.8 to 3 times.

O. C. Zienkiewicz, J. Z. Zhu, A simple error estimator and adaptive procedure for practical
engineering analysis, Int. J. Numer. Meth. Engng 24, 1987, 337–357; The superconvergent patch
recovery and a posteriori error estimates, part 1, ibid. 33, 1992, 1331–1364.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orchestrator.method.stopping.discretisation import Estimator, mean_square
from orchestrator.scene.model import Scene

# 2/β², for β² = ½ of compact bodies: the bulk modulus over μ beyond which it is none of the error's
# business
SOFTEST = 4.0
SLOPE = 0.01  # τ: a hundredth of what a patch is wide


class RecoveredStresses(Estimator):
    """The estimate for four-node tets.

    corner : (4, m) int, of each cell's nodes the place where stress is recovered: within one
        matter, and one for nodes that are joined
    shares : (4, m) of each cell's stress in what is recovered there; they add up to one
    """

    def _prepare(self, nodes: np.ndarray, label: np.ndarray) -> None:
        # what counts is whether the moduli differ, not whether the configuration lists them apart
        matter = np.unique(self.lame[:, 0] + 1j * self.lame[:, 1], return_inverse=True)[1].ravel()
        keys = self.joined[self.cells.T] * (int(matter.max(initial=0)) + 1) + matter
        occurs = np.zeros(int(keys.max()) + 1, dtype=bool)
        occurs[keys] = True
        self.corner = (np.cumsum(occurs) - 1).astype(np.int32)[keys]
        self.count = int(self.corner.max()) + 1
        self.shares = self._shares(nodes)

    def _errors(self, stresses: Sequence[np.ndarray], numbers: Sequence[int | None]) -> np.ndarray:
        return np.stack([self._error(sigma) for sigma in stresses])

    def _error(self, sigma: np.ndarray) -> np.ndarray:
        """(m,) η² with λ/(3λ + 2μ) = 1/3 − 2μ/9K of the bulk modulus K, or of ``SOFTEST`` μ."""
        first, second = self.lame.T
        at_least = np.minimum(first / (3 * first + 2 * second), 1 / 3 - 2 / (9 * SOFTEST))
        error, (trace, gap) = np.zeros(len(self.cells)), np.zeros((2, *self.corner.shape))
        for c, (component,) in enumerate(sigma):
            # no index is beyond: that is fastest
            self._sum(self.shares * component).take(self.corner, out=gap, mode="clip")
            gap -= component
            error += mean_square(gap) if c < 3 else 2 * mean_square(gap)
            if c < 3:
                trace += gap
        error -= at_least * mean_square(trace)
        return np.maximum(error, 0.0) * self.volumes / (2 * second)

    def _shares(self, nodes: np.ndarray) -> np.ndarray:
        """(4, m) as weights of volumes: w = 1/V* − d̄ · (Σ V (d − d̄)(d − d̄)ᵀ + τ s)⁻¹ (d − d̄), d
        = c − x and d̄ its mean, V* = Σ V.
        """
        whole = self._sum(np.ones((1, len(self.cells))))
        # (3, 4, m)
        away = (nodes[self.cells].mean(axis=1)[:, None] - nodes[self.cells]).transpose(2, 1, 0)
        mean = np.stack([self._sum(one) for one in away]) / whole
        spread = np.stack([[self._sum(one * two) for two in away] for one in away])
        narrow = SLOPE * np.trace(spread) / 3
        spread += narrow * np.eye(3)[:, :, None] - whole * mean[:, None] * mean
        slope = np.linalg.solve(spread.transpose(2, 0, 1), mean.T[:, :, None])[:, :, 0].T
        return (1 / whole + (slope * mean).sum(axis=0))[self.corner] - sum(
            b[self.corner] * d for b, d in zip(slope, away))

    def _sum(self, values: np.ndarray) -> np.ndarray:
        """(K,) nodal sums of (4 or 1, m), weighted by volume."""
        shares = np.broadcast_to(self.volumes * values, self.corner.shape)
        return sum(np.bincount(nodes, share, self.count)
                   for nodes, share in zip(self.corner, shares))


def estimator_of(scene: Scene) -> Estimator:
    """Return the estimate of a scene: of ten-node tets by a problem in each, of others as above."""
    if scene.mesh.cells.shape[1] != 10:
        return RecoveredStresses.of(scene)
    # this alone needs SciPy's special functions
    from orchestrator.method.stopping.element_problems import ElementProblems

    return ElementProblems.of(scene)
