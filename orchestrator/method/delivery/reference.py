"""The undecomposed solution by the same black box, and the true error against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from orchestrator.blackbox.models.extended import whole_model
from orchestrator.blackbox.protocol import BlackBox
from orchestrator.method.decomposition import Decomposition
from orchestrator.method.delivery.one_piece import constrained, constraints
from orchestrator.method.delivery.recovery import of_all, on_mesh, recover
from orchestrator.method.linear.stage import Admissible
from orchestrator.method.load_cases import LoadCases
from orchestrator.method.refusal import Refusal
from orchestrator.method.stopping.bound import Bound
from orchestrator.scene.model import Scene
from orchestrator.timing import Stopwatch


@dataclass
class Reference:
    """Solution of the whole structure in one piece.

    Parameters
    ----------
    displacement : (T, n, 3)
    stiffness : (3n, 3n) sparse
    energy : (T,) ‖u‖²_K
    """

    displacement: np.ndarray
    stiffness: sp.csr_array
    energy: np.ndarray

    def relative_error(self, displacement: np.ndarray) -> float:
        """max_t ‖u − u_ref‖_K / max_t ‖u_ref‖_K for u (T, n, 3), the measure that the bound bounds."""
        gap = _energies(self.stiffness, displacement - self.displacement)
        size = self.energy.max(initial=0.0)
        return float(np.sqrt(gap.max() / size)) if size > 0 else float(np.sqrt(gap.max(initial=0.0)))


def check_reference(scene: Scene) -> None:
    """Raises ``Refusal`` where the undecomposed solution is that of another problem."""
    if not all(i.law.perfect for i in scene.interfaces):
        raise Refusal("no undecomposed solution")


def solve_reference(scene: Scene, blackbox: BlackBox) -> Reference:
    """Solve all load steps without decomposition; where interfaces join nodes that are no common ones, with their operators.

    Raises
    ------
    BlackBoxError : from the code, also when memory runs out
    Refusal : sides that cannot come together
    """
    stiffness = blackbox.stiffness([whole_model(scene)])[0]
    joined = constraints(scene)
    displacement = constrained(scene, stiffness, joined) if joined.shape[0] else undecomposed(scene, blackbox, stiffness)
    return Reference(displacement, stiffness, _energies(stiffness, displacement))


def undecomposed(scene: Scene, blackbox: BlackBox, stiffness: sp.csr_array | None = None) -> np.ndarray:
    """Displacement (T, n, 3) of the whole structure in one piece.

    Parameters
    ----------
    stiffness : (3n, 3n); needed where displacements other than zero are prescribed
    """
    blackbox.load([whole_model(scene)])
    lift = np.where(scene.fixed, scene.prescribed, 0.0).reshape(scene.steps, -1)
    forces = scene.loads.reshape(scene.steps, -1)
    if lift.any():
        forces = forces - (stiffness @ lift.T).T
    forces = np.where(scene.fixed.ravel(), 0.0, forces)
    return (lift + blackbox.fields({0: forces})[0]).reshape(scene.steps, -1, 3)


class TrueError:
    """Follows the true error of the iterations; the loop calls it.

    Parameters
    ----------
    d : the decomposition that is iterated
    scene : the whole one, on rank 0
    cases : how all load steps follow from its own
    exact : the undecomposed solution, of the whole scene; on rank 0

    Attributes
    ----------
    asked : seconds that the black box has been asked for it
    """

    def __init__(self, d: Decomposition, scene: Scene | None, cases: LoadCases, exact: Reference | None, watch: Stopwatch):
        self.d, self.scene, self.cases, self.exact, self.watch = d, scene, cases, exact, watch
        self.asked = 0.0

    def __call__(self, fields: Admissible, bound: Bound) -> float:
        """Of what would be delivered; costs one back-substitution per subdomain and load step."""
        asked = self.d.blackbox.usage.asked
        with self.watch("reference"):
            found = of_all(self.d, recover(self.d, fields, bound)[0])
            error = self.d.space.team.share(self.exact and self.exact.relative_error(
                self.cases.all_steps(on_mesh(self.scene, found))))
        self.asked += self.d.blackbox.usage.asked - asked
        return error


def _energies(stiffness: sp.csr_array, displacement: np.ndarray) -> np.ndarray:
    flat = displacement.reshape(len(displacement), -1).T
    return np.maximum(np.sum(flat * (stiffness @ flat), axis=0), 0.0)
