"""Estimate of the discretisation error from recovered stresses (Zienkiewicz and Zhu).

A nodal stress σ* is recovered from the surrounding cells' stresses and interpolated like the displacement. It is closer to the exact stress
than the finite element stress σ itself, so that their distance estimates the error:

    η²_cell = ∫_cell (σ* − σ) : C⁻¹ (σ* − σ),     η² = Σ η²_cell

Of ten-node tets it is the mean of the cells' own stresses there, by volume. Of four-node ones, whose stress is that of their centroid c, it
is what a linear function has at the node x, the one nearest to the stresses of the patch:

    min Σ V |σ − a − b·(c − x)|² + τ s |b|²,     σ*(x) = a,     s = Σ V |c − x|² / 3

On surfaces and interfaces all cells are on one side, and a mean would be the stress somewhere inside. Patches that do not tell a slope, as
where one cell is all there is, have a small one by τ, and a mean.

Stresses are recovered within one matter and over perfect interfaces only: true jumps of the stress, from one material to
the next and across interfaces that open or slip, are not smoothed away and so not taken for errors.

Nearly incompressible matter needs one thing more. Elements that lock move too little, and smoothly: their stress deviator
shows nothing. What gives them away is the pressure, which carries the loads in their place and leaps from cell to cell;
C⁻¹ divides its square by the bulk modulus K, so that the estimate would vanish as ν goes to ½. But an error of the pressure
p is never alone. Errors of both are in balance, ∫ 2μ ε' : ε'(v) = ∫ p div v for all v, so that with β the inf-sup constant

    ∫ 2μ ε' : ε' ≥ β² ∫ p²/2μ,

and pressures are divided by the smaller of K and ``SOFTEST`` μ. Below ν = 0.385 that is K. Measured against much finer
solutions (bending, tension and compression of blocks between plates, a loaded corner; four- and ten-node tets) the
estimate then is 0.7 to 1.6 times the truth up to ν = 0.49, from there 0.8 to 3 times.

O. C. Zienkiewicz, J. Z. Zhu, A simple error estimator and adaptive procedure for practical engineering analysis,
Int. J. Numer. Meth. Engng 24, 1987, 337–357; The superconvergent patch recovery and a posteriori error estimates, part 1, ibid. 33, 1992,
1331–1364.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.method.linear.loading import NOTHING
from orchestrator.parallel.borders import Meeting
from orchestrator.parallel.team import ALONE
from orchestrator.scene.elasticity import CENTRE, strain, stress
from orchestrator.scene.mesh.faces import components
from orchestrator.scene.mesh.geometry import shape_gradients
from orchestrator.scene.mesh.quadratic import TET_EDGES
from orchestrator.scene.model import Scene

SOFTEST = 4.0  # 2/β², for β² = ½ of compact bodies: the bulk modulus over μ beyond which it is none of the error's business
SLOPE = 0.01  # τ: a hundredth of what a patch is wide
_WEIGHT = (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)  # shear stresses stand twice in the tensor


@dataclass(frozen=True)
class Estimate:
    """The estimated discretisation error, all load steps together.

    relative : max_t η_t / max_t √(‖u_t‖² + η_t²), in the energy norm
    cells : (T, m) share of each cell, among ranks of its own ones; the largest root of a step's sum of squares is ``relative``
    size : what both are relative to, the root of an energy
    """

    relative: float
    cells: np.ndarray
    size: float = 1.0


class Estimator:
    """The estimate for one mesh, or a rank's part of it.

    nodes : (n, 3); cells : (m, 4 or 10) int, on nodes of which bodies have their own
    joined : (n,) int, equal where perfect interfaces make nodes one
    lame : (m, 2), Lamé's λ and μ
    thermal : (T, m, 4) thermal strain at the corners; None where nothing is heated
    order : (m,) int, where shares of the cells are wanted; None: as they stand
    meeting : where others have parts of the mesh
    gradients, volumes : (m, 4, 3) and (m,), of the linear shape functions
    corner : (p, m) int, of each cell's nodes the place where stress is recovered: within one matter, and one for nodes that are joined
    shares : (p, m) of each cell's stress in what is recovered there; they add up to one
    """

    def __init__(self, nodes: np.ndarray, cells: np.ndarray, joined: np.ndarray, lame: np.ndarray, thermal: np.ndarray | None = None,
                 order: np.ndarray | None = None, meeting: Meeting | None = None):
        self.cells, self.lame, self.thermal, self.order = cells, lame, thermal, slice(None) if order is None else order
        self.joined = joined
        self.gradients, self.volumes = shape_gradients(nodes, cells)
        # what counts is whether the moduli differ, not whether the configuration lists them apart
        matter = np.unique(lame[:, 0] + 1j * lame[:, 1], return_inverse=True)[1].ravel()
        keys = joined[cells.T] * (int(matter.max(initial=0)) + 1) + matter
        occurs = np.zeros(int(keys.max()) + 1, dtype=bool)
        occurs[keys] = True
        self.corner = (np.cumsum(occurs) - 1).astype(cells.dtype)[keys]
        self.count = int(self.corner.max()) + 1
        self.team, self._borders = ALONE, None
        if meeting is not None:
            node, behind = np.empty((2, self.count), dtype=int)
            node[self.corner], behind[self.corner] = cells.T, np.arange(len(cells))
            self.team, self._borders = meeting.team, meeting.borders(node, lame[behind])
        self.shares = self._shares(nodes)
        self.product = _mean_products(cells.shape[1])

    @classmethod
    def of(cls, scene: Scene) -> Estimator:
        """For a whole scene of four-node or ten-node tets, every subdomain with its own nodes, one after another."""
        offsets = np.cumsum([0, *(len(s.nodes) for s in scene.subdomains)])
        order = np.concatenate([s.cells for s in scene.subdomains])
        kind = np.int32 if offsets[-1] < np.iinfo(np.int32).max else np.int64
        cells = np.concatenate([(s.connectivity + a).astype(kind) for s, a in zip(scene.subdomains, offsets)])
        nodes = scene.mesh.nodes[np.concatenate([s.nodes for s in scene.subdomains])]
        bonded = [i for i in scene.interfaces if i.law.perfect and i.mortar is None]
        one, two = (np.concatenate([i.nodes[side] + offsets[i.subdomains[side]] for i in bonded] or [np.empty(0, int)]) for side in (0, 1))
        lame = np.array([m.lame for m in scene.materials])[scene.cell_material[order]]
        return cls(nodes, cells, components(one, two, len(nodes))[1], lame, None if scene.thermal is None else scene.thermal[:, order],
                   order)

    def __call__(self, sides: Sequence[np.ndarray], numbers: Sequence[int] | None = None) -> Estimate:
        """Estimate the error of displacements.

        sides : per subdomain (T, n_E, 3), continuous over perfect interfaces
        numbers : (T,) which load steps of the scene these are; none: all
        """
        displacement = np.concatenate(sides, axis=1)
        numbers = range(len(displacement)) if numbers is None else numbers
        squares, energies = np.empty((2, len(displacement), len(self.cells)))
        alone = np.zeros(len(displacement))
        for t, (u, number) in enumerate(zip(displacement, numbers)):
            squares[t, self.order], energies[t] = self._squares(self._stress(u, number), number)
            alone[t] = energies[t].sum() + moved_alone(u, self.cells, self.volumes, self.lame)
            if self.thermal is not None:  # errors of stresses, relative to the size of displacements like all others
                energies[t] = self._squares(self._stress(u))[1]
        errors, energy, alone = self.team.sum(squares.sum(axis=1), energies.sum(axis=1), alone)
        size = size_of(energy + errors, alone)
        return Estimate(float(np.sqrt(errors.max(initial=0.0)) / size), np.sqrt(squares) / size, size)

    def energy(self, sides: Sequence[np.ndarray]) -> np.ndarray:
        """(T,) ‖u‖² in the energy norm, parameters as for the estimate."""
        return np.array([self.energies(u).sum() for u in np.concatenate(sides, axis=1)])

    def energies(self, displacement: np.ndarray) -> np.ndarray:
        """(m,) ∫ ε : C ε of the cells as they stand, from displacements (n, 3)."""
        return self._squares(self._stress(displacement))[1]

    def squares(self, broken: np.ndarray, number: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(m,) η² and energies of the cells as listed, of displacements at their own nodes (m, 4 or 10, 3), which may leap between them.

        number : load step of the scene, whose loads inside the cells count; None: there are none
        """
        apart = np.arange(self.cells.size).reshape(self.cells.shape)
        return self._squares(self._stress(broken.reshape(-1, 3), number, apart), number)

    def _stress(self, displacement: np.ndarray, number: int | None = None, cells: np.ndarray | None = None) -> np.ndarray:
        """(6, p, m) stress at the cells' own p nodes; (6, 1, m) where it is the same at all.

        number : load step of the scene, whose thermal strain is without stress; None: all strain has stress
        cells : on the nodes of the displacement, if these are others
        """
        ten, cells = self.cells.shape[1] == 10, self.cells if cells is None else cells

        def elastic(at: np.ndarray) -> np.ndarray:
            epsilon = strain(self.gradients, cells, displacement, at)
            if self.thermal is not None and number is not None:
                epsilon[:, :3] -= (self.thermal[number] @ at)[:, None]
            return epsilon

        corners = np.stack([stress(elastic(at), self.lame).T for at in (np.eye(4) if ten else [CENTRE])], axis=1)
        return np.concatenate([corners, corners[:, TET_EDGES].mean(axis=2)], axis=1) if ten else corners

    def _squares(self, sigma: np.ndarray, number: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(m,) η² and (m,) energy ∫ σ : C⁻¹σ of the cells, from their stress (6, p or 1, m).

        number : load step of the scene, whose body forces count where an estimate knows them

        C⁻¹σ = (σ − λ/(3λ + 2μ) tr σ I) / 2μ,  λ/(3λ + 2μ) = 1/3 − 2μ/9K
        """
        first, second = self.lame.T
        dilation = first / (3 * first + 2 * second)
        at_least = np.minimum(dilation, 1 / 3 - 2 / (9 * SOFTEST))  # the same with K = SOFTEST μ
        error, energy = np.zeros((2, len(self.cells)))
        trace, gap = np.zeros((2, *self.corner.shape))
        for component, weight in zip(sigma, _WEIGHT):
            self._mean(component).take(self.corner, out=gap, mode="clip")  # no index is beyond: that is fastest
            gap -= component
            error += weight * self._mean_square(gap)
            energy += weight * self._mean_square(component)
            if weight == 1:
                trace += gap
        error -= at_least * self._mean_square(trace)
        energy -= dilation * self._mean_square(sigma[:3].sum(axis=0))
        scale = self.volumes / (2 * second)
        return np.maximum(error, 0.0) * scale, energy * scale

    def _mean(self, component: np.ndarray) -> np.ndarray:
        """(K,) recovered at nodes from (p or 1, m)."""
        return self._sum(self.shares * component)

    def _shares(self, nodes: np.ndarray) -> np.ndarray:
        """(p, m) as weights of volumes: w = 1/V* − d̄ · (Σ V (d − d̄)(d − d̄)ᵀ + τ s)⁻¹ (d − d̄), d = c − x and d̄ its mean, V* = Σ V."""
        whole = self._sum(np.ones((1, len(self.cells))))
        if len(self.corner) == 10:
            return 1 / whole[self.corner]
        away = (nodes[self.cells].mean(axis=1)[:, None] - nodes[self.cells]).transpose(2, 1, 0)  # (3, 4, m)
        mean = np.stack([self._sum(one) for one in away]) / whole
        spread = np.stack([[self._sum(one * two) for two in away] for one in away])
        narrow = SLOPE * np.trace(spread) / 3
        spread += narrow * np.eye(3)[:, :, None] - whole * mean[:, None] * mean
        slope = np.linalg.solve(spread.transpose(2, 0, 1), mean.T[:, :, None])[:, :, 0].T
        return (1 / whole + (slope * mean).sum(axis=0))[self.corner] - sum(b[self.corner] * d for b, d in zip(slope, away))

    def _sum(self, values: np.ndarray) -> np.ndarray:
        """(K,) nodal sums of (p or 1, m), weighted by volume."""
        shares = np.broadcast_to(self.volumes * values, self.corner.shape)
        total = sum(np.bincount(nodes, share, self.count) for nodes, share in zip(self.corner, shares))
        return total if self._borders is None else self._borders(total)

    def _mean_square(self, values: np.ndarray) -> np.ndarray:
        """(m,) mean over each cell of the square of the function with these nodal values (p or 1, m)."""
        return values[0] ** 2 if len(values) == 1 else np.einsum("pm,pm->m", self.product @ values, values)


def moved_alone(u: np.ndarray, cells: np.ndarray, volumes: np.ndarray, lame: np.ndarray) -> float:
    """Energy that the displacements u (n, 3) of cells' corners would have about, each moved alone: rounding of a motion is no strain."""
    square = np.einsum("nc,nc->n", u, u)[cells[:, :4]].sum(axis=1)
    return float(square @ (np.cbrt(np.abs(volumes)) * (lame[:, 0] + 2 * lame[:, 1])))


def size_of(squares: np.ndarray, alone: np.ndarray) -> float:
    """What estimated errors are relative to, from ‖u‖² (T,): what rounding leaves of zero has no error of its own.

    alone : (T,) energies of which ``squares`` would be rounding
    """
    own, most = (float(np.sqrt(max(x.max(initial=0.0), 0.0))) for x in (squares, alone))
    return max(own, NOTHING * most) or 1.0


def _mean_products(count: int) -> np.ndarray:
    """(p, p) mean over a tet of the products of its p = 4 or 10 shape functions: its mass matrix over its mass."""
    if count == 4:
        return (1 + np.eye(4)) / 20
    ends = (np.array(TET_EDGES)[:, :, None] == np.arange(4)).any(axis=1).astype(float)  # (6, 4), whether a corner is an edge's
    return np.block([[1 + 5 * np.eye(4), 2 * ends.T - 6], [2 * ends - 6, 8 * (1 + ends @ ends.T + np.eye(6))]]) / 420
