"""Which estimate of the discretisation error belongs to which tets."""

from __future__ import annotations

from orchestrator.method.stopping.discretisation import Estimator
from orchestrator.method.stopping.recovered_stresses import RecoveredStresses
from orchestrator.scene.model import Scene


def kind_of(nodes: int) -> type[Estimator]:
    """The estimate for tets of so many nodes: of ten by a problem in each, of four by recovered stresses."""
    if nodes != 10:
        return RecoveredStresses
    from orchestrator.method.stopping.element_problems import ElementProblems  # these alone need SciPy's special functions

    return ElementProblems


def estimator_of(scene: Scene) -> Estimator:
    """That of a whole scene."""
    return kind_of(scene.mesh.cells.shape[1]).of(scene)
