"""The undecomposed solution by the same black box, the true error against it, and the mesh's
estimated error on the way.

Where interfaces join nodes that are no common ones the structure in one piece is

    min ½ uᵀK u − fᵀu   where   B u = 0,      B u = G₂ u₂ − G₁ u₁  on every interface,

by augmented Lagrangians (Hestenes, J. Optim. Theory Appl. 4, 1969): with K + γ BᵀB, which is
positive definite and is factorised once,

    u ← (K + γ BᵀB)⁻¹ (f − Bᵀλ),      λ ← λ + γ B u

leaves less of the jump in each round by the softness of the structure beside γ. Constraints that
say the same twice, where interfaces meet, do no harm. Nothing of the decomposed method is used but
the operators.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models import whole_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.errors import Refusal
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.recovery import of_all, on_mesh, recover
from orchestrator.method.sparse.symmetric import factorise
from orchestrator.method.interface.rows import peak, unit_rows
from orchestrator.method.iterated import LoadCases
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.stopping.error_estimate import Judged
from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.method.stopping.recovered_stresses import estimator_of
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch

# γ over the bodies' stiffness at the nodes: leaves some 1e-3 of a jump per round, and ten digits of
# K in K + γ BᵀB.
STIFF = 1e3
# A jump this small beside the displacements is none; rounds that it may take.
CLOSED, ROUNDS = 1e-12, 40


@dataclass
class Reference:
    """Solution of the whole structure in one piece."""

    displacement: np.ndarray  # (T, n, 3)
    stiffness: sp.csr_array  # (3n, 3n)
    energy: np.ndarray  # (T,) ‖u‖²_K

    def relative_error(self, displacement: np.ndarray) -> float:
        """max_t ‖u − u_ref‖_K / max_t ‖u_ref‖_K for u (T, n, 3), the measure that the bound
        bounds.
        """
        gap = _energies(self.stiffness, displacement - self.displacement)
        size = peak(self.energy)
        return float(np.sqrt(gap.max() / size)) if size > 0 else float(np.sqrt(peak(gap)))


def check_reference(scene: Scene) -> None:
    """Raises ``Refusal`` where the undecomposed solution is that of another problem."""
    if not scene.bonded:
        raise Refusal("no undecomposed solution")


def solve_reference(scene: Scene, blackbox: BlackBox) -> Reference:
    """Solve all load steps without decomposition; where interfaces join nodes that are no common
    ones, with their operators.

    Raises BlackBoxError: from the code, also when memory runs out
    Raises Refusal: sides that cannot come together
    """
    stiffness = blackbox.stiffness([whole_model(scene)])[0]
    joined = _constraints(scene)
    displacement = _constrained(scene, stiffness,
                                joined) if joined.shape[0] else undecomposed(
                                    scene, blackbox, stiffness)
    return Reference(displacement, stiffness, _energies(stiffness, displacement))


def undecomposed(scene: Scene, blackbox: BlackBox,
                 stiffness: sp.csr_array | None = None) -> np.ndarray:
    """Displacement (T, n, 3) of the whole structure in one piece; ``stiffness`` (3n, 3n) is needed
    where displacements other
    than zero are prescribed."""
    blackbox.load([whole_model(scene)])
    lift = np.where(scene.fixed, scene.prescribed, 0.0).reshape(scene.steps, -1)
    forces = scene.loads.reshape(scene.steps, -1)
    if lift.any():
        forces = forces - (stiffness @ lift.T).T
    forces = np.where(scene.fixed.ravel(), 0.0, forces)
    return (lift + blackbox.fields({0: forces})[0]).reshape(scene.steps, -1, 3)


def _constraints(scene: Scene) -> sp.csr_array:
    """(q, 3n) B on the nodes of the mesh; no rows where all interfaces join common nodes."""
    def picked(nodes: np.ndarray) -> sp.csr_array:
        return unit_rows((3 * nodes[:, None] + np.arange(3)).ravel(), 3 * len(scene.mesh.nodes))

    blocks = [picked(np.empty(0, int))]
    for i in scene.interfaces:
        one, two = (scene.side_nodes(i, side) for side in (0, 1))
        if i.mortar is not None:
            live = np.flatnonzero(i.mortar.live)
            blocks.append(i.mortar.second[live] @ picked(two) - i.mortar.first[live] @ picked(one))
        elif not np.array_equal(one, two):
            blocks.append(picked(two) - picked(one))
    return sp.vstack(blocks)


def _constrained(scene: Scene, stiffness: sp.csr_array, B: sp.csr_array) -> np.ndarray:
    """Displacement (T, n, 3) of the bodies with K (3n, 3n) and constraints B (q, 3n)."""
    loose = np.flatnonzero(~scene.fixed.ravel())
    lift = np.where(scene.fixed, scene.prescribed, 0.0).reshape(scene.steps, -1)
    right = (scene.loads.reshape(scene.steps, -1) - (stiffness @ lift.T).T)[:, loose]
    gap, inner, free = (B @ lift.T).T, stiffness[loose][:, loose], B[:, loose]
    met = np.unique(free.indices)
    gamma = STIFF * float(np.mean(inner.diagonal()[met])) if len(met) else 1.0
    solve = factorise(inner + gamma * (free.T @ free))
    force, u = np.zeros((scene.steps, B.shape[0])), np.zeros((scene.steps, len(loose)))
    for _ in range(ROUNDS):
        rest = right - (inner @ u.T).T - (free.T @ (force + gamma * ((free @ u.T).T + gap)).T).T
        u = u + solve(rest)
        jump = (free @ u.T).T + gap
        force += gamma * jump
        size = max(peak(u), peak(lift))
        if peak(jump) <= CLOSED * size:
            break
    else:
        raise Refusal("bonds that do not close", jump=np.abs(jump).max(), size=size)
    lift[:, loose] += u
    return lift.reshape(scene.steps, -1, 3)


def _energies(stiffness: sp.csr_array, displacement: np.ndarray) -> np.ndarray:
    flat = displacement.reshape(len(displacement), -1).T
    return np.maximum(np.sum(flat * (stiffness @ flat), axis=0), 0.0)


class WholeErrors:
    """Errors of what would be delivered that rank 0 alone can tell, of the whole scene; all ranks
    ask together, and get the same. One back-substitution per subdomain and load step each.

    scene : the whole one, on rank 0
    cases : how all load steps follow from those that are solved
    exact : the undecomposed solution, on rank 0 where it is asked for

    asked : seconds that the black box has been asked for the true error
    """

    def __init__(self, scene: Scene | None, cases: LoadCases, exact: Reference | None,
                 watch: Stopwatch):
        self.scene, self.cases, self.exact, self.watch, self.asked = scene, cases, exact, watch, 0.0

    @cached_property
    def estimator(self) -> Estimator:
        """The estimate of the mesh's error, prepared when first asked."""
        return estimator_of(self.scene)

    def given(self, exact: bool) -> dict[str, Callable[..., float]]:
        """Return what monitors ask, by their names; ``exact``: the true error as well."""
        return {"estimate": self.of_mesh} | ({"true_error": self.true} if exact else {})

    def true(self, d: Decomposition, fields: Admissible, bound: Judged) -> float:
        """Return the true error, relative, energy norm."""
        asked = d.blackbox.usage.asked
        with self.watch("reference"):
            found = of_all(d, recover(d, fields, bound)[0])
            error = d.space.team.share(self.exact and self.exact.relative_error(
                self.cases.all_steps(on_mesh(self.scene, found))))
        self.asked += d.blackbox.usage.asked - asked
        return error

    def of_mesh(self, d: Decomposition, fields: Admissible, bound: Judged) -> float:
        """Return the estimated discretisation error, relative, energy norm."""
        found, team = of_all(d, recover(d, fields, bound)[0]), d.space.team
        # with contact, the steps left out are smaller than those they follow from
        numbers = None if d.all_perfect else d.local.pairs.numbers
        return team.share(None if team.rank else self.estimator(
            [self.cases.all_steps(u) for u in found], numbers).relative)
