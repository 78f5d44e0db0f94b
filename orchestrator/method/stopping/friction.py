"""Energy error with Coulomb's friction: the factor with which it is guaranteed, where
it can be.

E of ``stopping.certificate`` takes the limits of friction from its own pressures p̂. Expanded about
a solution u* with Coulomb's law,

    ‖v − u*‖² + ‖û − u*‖²  ≤  E² + 2 Σ μ (p* − p̂)(|Δv| − |Δu*|)

with the slips Δ of the load step. In the first load step both begin at the same jump, so that |
|Δv| − |Δu*| | ≤ |B_t(v − u*)|. With K the bodies' stiffness, all of them held, and weights D > 0 of
the pairs,

    Σ μ D |B_t x|² ≤ λ_T ‖x‖²      λ_T: the largest eigenvalue of B_tᵀ μ D B_t x = λ K x
    Σ μ (p* − p̂)²/D ≤ λ_N ‖û − u*‖²      λ_N: that of (μ/D)^½ Q K Qᵀ (μ/D)^½

where Q reads pressures off the nodal forces K(û − u*), at nodes that no other interface meets. So
the sum is q ‖v − u*‖ ‖û − u*‖ at most, q² = λ_T λ_N, and the largest ‖v − u*‖ that this allows is

    ‖v − u*‖ ≤ E/√(1 − q²)      where q < 1

(there the solution is unique as well). Q takes from either side a share by the other's stiffness,
which makes λ_N about the least that forces in balance allow, and D is the stiffness of both sides
in a row: q does not depend on the units, nor on a softer neighbour. It grows like the root of the
number of elements along an interface. λ_N takes sparse products alone, as the stiffness on the
boundary is not below its Schur complement; λ_T some back-substitutions. Eigenvalues are approached
from below: what residuals leave open is added.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.sparse as sp

from orchestrator.method.interface.pairs import Pairs
from orchestrator.method.interface.rows import Blocks, ratio, scattered, ColumnSegments, times
from orchestrator.method.linear.stage import LinearStage

STEPS = 300  # of either eigenvalue's method at most
# Of an eigenvalue, what may be left open. Where much is, it may be another one than the largest: of
# 40 pairs of blocks 0.02 missed λ_N,
# whose neighbours are near, by 3 % in six, λ_T in none. λ_N takes no back-substitutions.
OPEN = {"pressures": 1e-6, "slips": 0.01}


class Friction:
    """The factor of one decomposition whose bodies are all held, for its first load step.

    pairs : points of all interfaces, perfect ones included, without springs
    stiffness : (B, B) of the subdomains on their boundary dofs
    stage : linear stage

    coefficient : (P,) μ of each pair
    read : (3P, D + G) rows that read the pairs' forces off those of the nodes; weight : (P,) D,
        infinite where they cannot
    """

    def __init__(self, pairs: Pairs, stiffness: Blocks, stage: LinearStage):
        self.pairs, self.stiffness, self.stage, self.space = pairs, stiffness, stage, stage.space
        self.coefficient = np.zeros(len(pairs))
        for run in pairs.runs:
            if run.law.slips:
                self.coefficient[run.part] = run.points.at(int(pairs.numbers[0]))["friction"]
        self.read, self.weight = self._reading()

    def factor(self, softness: np.ndarray) -> float:
        """1/√(1 − q²), nan where q is not below 1 or cannot be known; ``softness``: (S,) σ of the
        own subdomains, see ``softest``.
        """
        rubs = self.coefficient > 0
        rubbing, unread = self.space.team.max(float(rubs.any()),
                                              float(np.isinf(self.weight[rubs]).any()))
        if not rubbing:
            return 1.0
        if unread:
            return np.nan
        pressures = self._of_pressures()
        q2 = pressures * self._of_slips(softness, 1 / pressures)
        return float(1 / np.sqrt(1 - q2)) if q2 < 1 else np.nan

    def _reading(self) -> tuple[sp.csr_array, np.ndarray]:
        """``read`` and ``weight``: where nodes are paired of either side, a share by the other's
        stiffness; else of the first side.
        """
        space, pairs = self.space, self.pairs
        gather, there = space.gather, space.gather >= 0
        # that a boundary dof is on
        interfaces = np.bincount(gather[there], minlength=len(space.global_dof))
        alone = there & (interfaces.take(gather) == 1 if len(interfaces) else there)
        diagonal, = space.trace(self.stiffness.diagonal()[None])
        (diagonal, alone), = space.extended(np.array([diagonal, alone]))

        def along(rows: sp.csr_array) -> np.ndarray:
            """(P,) the stiffness of a side along the normal; infinite where others meet its nodes,
            or supports do, or it is not there.
            """
            others = times(abs(rows), 1 - alone[None]).reshape(3, -1).any(axis=0)
            found = np.sum(pairs.points.normal**2 * times(abs(rows), diagonal[None]).reshape(3, -1),
                           axis=0)
            return np.where(others | (found == 0), np.inf, found)

        one, two = self._sides()
        first, second = along(one), along(two)
        with np.errstate(invalid="ignore"):
            share = np.where(np.isinf(second), 1.0,
                             np.where(np.isinf(first), 0.0, second / (first + second)))
            weight = np.where(share > 0, share * first, second)
        return sp.diags_array(np.tile(share, 3)) @ one - sp.diags_array(
            np.tile(1 - share, 3)) @ two, weight

    def _sides(self) -> tuple[sp.csr_array, sp.csr_array]:
        """(3P, D + G) rows that read the pairs' forces off those of either side alone, empty ones
        of a second that does not tell.
        """
        transfer = self.pairs.transfer
        first, read = np.zeros(transfer.total), transfer.products.E
        for i in self.pairs.interfaces:
            first[transfer.sides[i.index][0]] = 1.0
        one, two = (read @ sp.diags_array(side) for side in (first, first - 1))
        # where nodes are paired half is read off either side
        both = sp.diags_array(1.0 + (abs(two).sum(axis=1) > 0))
        return both @ one, both @ two

    def _of_pressures(self) -> float:
        """λ_N, of pairs: those of two ranks are with both."""
        space, normal, mine = self.space, self.pairs.points.normal, self.pairs.mine
        scale = normal * np.sqrt(ratio(self.coefficient, self.weight))

        def read(loads: np.ndarray) -> np.ndarray:
            """(P,) pressures of forces (B,), scaled."""
            traces = space.everywhere(loads[None])
            return np.sum(scale * times(self.read, traces).reshape(3, -1), axis=0)

        def product(y: np.ndarray) -> np.ndarray:
            traces = times(self.read.T, (scale * y).reshape(1, -1))[:, : space.size]
            return read(self.stiffness @ space.loads(traces)[0])

        def dot(rows: np.ndarray, b: np.ndarray) -> np.ndarray:
            return space.team.sum(rows[:, mine] @ b[mine])[0]

        return _largest(read(scattered(space.link.boundary_number)), product,
                        lambda r: (r, r, dot(r[None], r)[0]), dot, OPEN["pressures"])

    def _of_slips(self, softness: np.ndarray, most: float = np.inf) -> float:
        """λ_T, or any number above ``most`` where it is. K⁻¹ of what is left is known from above,
        as in ``dual_energy``.
        """
        space, pairs, of = self.space, self.pairs, ColumnSegments(self.space.boundary)
        weight = np.where(self.coefficient > 0, self.coefficient * self.weight, 0.0)

        def product(x: np.ndarray) -> np.ndarray:
            traces = space.everywhere(x[None])
            forces = weight * pairs.points.across(pairs.transfer.jump(traces))
            return -space.loads(pairs.transfer.opposed(forces)[:, : space.size])[0]

        def answered(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
            x = self.stage.solve(r[None])
            left, = space.team.sum(float(np.sum((1 + 1 / softness) * of.sums(r * x[0]))))
            return x[0], r - self.stage.direction.robin(x)[0], left

        return _largest(scattered(space.link.boundary_number), product, answered,
                        lambda rows, b: space.team.sum(rows @ b)[0], OPEN["slips"], most)


def _largest(r: np.ndarray, product: Callable, answered: Callable, dot: Callable,
             may_be_open: float, most: float = np.inf) -> float:
    """The largest λ of C x = λ S x, from above, infinite where it is not found: Davidson's method,
    Lanczos' where S is solved exactly.

    r : (n,) what it begins with; product : x → C x; dot : of rows (m, n) with (n,), (m,)
    answered : r → x ≈ S⁻¹r, S x, and what rᵀS⁻¹r is at most
    may_be_open : a share of it; most : above which it need not be known
    """
    vectors, images, products = np.zeros((3, 0, len(r)))
    matrix, value = np.zeros((0, 0)), 0.0
    for _ in range(STEPS):
        x, image, left = answered(r)
        left = float(np.sqrt(max(left, 0.0)))
        if len(vectors) and (left <= may_be_open * value or value > most):
            break
        for _ in range(2):  # rounding leaves a rest at first
            share = dot(images, x)
            x, image = x - share @ vectors, image - share @ images
        size = float(dot(image[None], x)[0])
        if not size > 0:
            break
        vectors, images = (np.vstack([rows, row / np.sqrt(size)])
                           for rows, row in ((vectors, x), (images, image)))
        products = np.vstack([products, product(vectors[-1])])
        column = dot(vectors, products[-1])
        matrix = np.block([[matrix, column[:-1, None]], [column[None]]])
        values, states = np.linalg.eigh(matrix)
        value = float(values[-1])
        r = states[:, -1] @ (products - value * images)
    else:
        return np.inf
    return value + left


def guarantee(pairs: Pairs, stiffness: Blocks, modes: list[np.ndarray], stage: LinearStage,
              softness: Callable[[], np.ndarray]) -> Callable[[], float]:
    """() → the factor with which E is a bound, found when first asked for; nan where it is an
    estimate.

    modes : per own subdomain (boundary dofs, r) rigid motions that its supports leave; else as for
        ``Friction`` and its ``factor``
    """
    interfaces, team = pairs.interfaces, stage.space.team
    follows, curved, unlike, loose = team.max(*(float(any(x)) for x in (
        (i.has_history and len(pairs.numbers) > 1 for i in interfaces),
        (not i.law.convex for i in interfaces),
        (not (i.law.convex or i.law.slips) for i in interfaces), (mode.size for mode in modes))))
    # what a load step begins with is known of the first alone
    if follows or unlike or curved and loose:
        return lambda: np.nan
    if not curved:
        return lambda: 1.0
    return cache(lambda: Friction(pairs, stiffness, stage).factor(softness()))
