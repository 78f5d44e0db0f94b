"""The accuracy that is asked of a run, in the energy norm, beside what a mesh and its iterations leave."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orchestrator.accuracy.measured import FORESEEN, TRUSTED
from orchestrator.method.stopping.discretisation import Estimate
from orchestrator.results.solution import Solution

ITERATIONS = 0.1  # share of the iterations in what is asked for
AIM = 0.9  # what a mesh is made for: sizes are followed within some tenths, and counts even out


@dataclass(frozen=True)
class Criterion:
    """What is asked and what a mesh leaves, all relative.

    asked : of mesh and iterations together
    estimated : the mesh's error as its estimate tells it by itself; share : measured, None where it is not
    foreseen : the share that the next mesh will be judged by
    iterations : their error, nan where it is not known; legs : both are legs of a right-angled triangle,
        else they add up
    cells : (T, m), √Σ cells² = estimated at the worst load step
    """

    asked: float
    estimated: float
    share: float | None
    foreseen: float
    iterations: float
    legs: bool
    cells: np.ndarray

    @property
    def mesh(self) -> float:
        """The mesh's error, raised where its estimate was measured to tell too little."""
        return self.estimated / (self.share or 1.0)

    @property
    def error(self) -> float:
        """Of mesh and iterations together."""
        return self._with_iterations(self.mesh)

    @property
    def met(self) -> bool:
        """Whether it is reached, even where the estimate tells as little as it may."""
        return bool(self._with_iterations(self.estimated / (self.share or TRUSTED)) <= self.asked)

    def goal(self, follows: bool) -> float:
        """What may be estimated on the next mesh; ``follows``: whether the iterations' tolerance does."""
        left = self.error - self.mesh
        allowed = min(left, ITERATIONS * self.asked) if follows else left
        return (AIM * self.asked - allowed) * self.foreseen

    def _with_iterations(self, mesh: float) -> float:
        if not math.isfinite(self.iterations):
            return mesh
        return math.hypot(mesh, self.iterations) if self.legs else mesh + self.iterations


def criterion(solution: Solution, found: Estimate, share: float | None, measurable: bool,
              asked: float) -> Criterion:
    """Return the criterion of a solution.

    found : the estimate; share : that it tells, see ``measured.told``
    measurable : whether the next mesh's will be
    """
    foreseen = share or (FORESEEN if measurable else TRUSTED)
    return Criterion(asked, found.relative, share, foreseen, solution.error_bound, solution.scene.bonded,
                     found.cells)
