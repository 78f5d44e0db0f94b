"""What may be asked of a run, one object for all: the error in the energy norm, or that of a quantity.

Elements r times as large leave r^p times the energy norm's error, but r^2p times a quantity's, which is a product of two: ``power`` 1
and 2. To the power 1/``power`` both fall alike, and the squares of ``cells`` add up to that of the mesh's error. Where an estimate tells
a share of the true error, see ``measured``, that of a product tells its square, as it is the same estimate of two solutions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.accuracy.measured import FORESEEN, TRUSTED
from orchestrator.method.stopping.discretisation import Estimate
from orchestrator.results.solution import Solution

ITERATIONS = 0.1  # share of the iterations in what is asked for
AIM = 0.9  # what a mesh is made for, of what is asked for: sizes are followed within some tenths, and counts of elements even out


@dataclass(frozen=True)
class Criterion:
    """One accuracy and what a mesh leaves, all relative.

    name : of the quantity, "" of the energy norm; value : its length
    asked : of mesh and iterations together, None where nothing is
    estimated : the mesh's error as its estimate tells it by itself; share : measured, None where it is not
    foreseen : the share that the next mesh will be judged by
    iterations : their error, nan where it is not known; legs : both are legs of a right-angled triangle, else they add up
    power : of the size of elements, over their order; cells : (T, m), √Σ cells² = estimated^(1/power) at the worst load step
    """

    name: str
    value: float
    asked: float | None
    estimated: float
    share: float | None
    foreseen: float
    iterations: float
    legs: bool
    power: int
    cells: np.ndarray

    @property
    def mesh(self) -> float:
        """The mesh's error, raised where its estimate was measured to tell too little."""
        return self.estimated / (self.share or 1.0) ** self.power

    @property
    def error(self) -> float:
        """Of mesh and iterations together."""
        return self._with_iterations(self.mesh)

    @property
    def met(self) -> bool:
        """Whether it is reached, even where the estimate tells as little as it may."""
        return bool(self._with_iterations(self.estimated / (self.share or TRUSTED) ** self.power) <= self.asked)

    def goal(self, follows: bool) -> float:
        """What may be estimated on the next mesh; ``follows``: whether the tolerance of the iterations does."""
        left = self.error - self.mesh
        return (AIM * self.asked - (min(left, ITERATIONS * self.asked) if follows else left)) * self.foreseen**self.power

    def _with_iterations(self, mesh: float) -> float:
        if not math.isfinite(self.iterations):
            return mesh
        return math.hypot(mesh, self.iterations) if self.legs else mesh + self.iterations

    def told(self) -> dict[str, float | None]:
        """Of a quantity, for the summary."""
        known = {"error": self.error, "mesh": self.mesh, "estimated": self.estimated, "iterations": self.iterations}
        return {"value": self.value, **{name: x if math.isfinite(x) else None for name, x in known.items()}, "asked": self.asked}


def criteria(solution: Solution, found: Estimate, share: float | None, measurable: bool, asked: float | None) -> list[Criterion]:
    """That of the energy norm, asked for or not, then those of quantities.

    found : the estimate in the energy norm; share : that it tells, see ``measured.told``; measurable : whether the next mesh's will be
    """
    foreseen = share or (FORESEEN if measurable else TRUSTED)
    return [Criterion("", 0.0, asked, found.relative, share, foreseen, solution.error_bound, solution.scene.bonded, 1, found.cells), *(
        Criterion(q.name, q.size, q.asked, q.mesh, share, foreseen, q.left, False, 2, np.sqrt(q.cells / q.size) if q.size else q.cells)
        for q in solution.quantities)]


def together(every: Sequence[Criterion], follows: bool) -> np.ndarray:
    """(T, m) the largest share of every element in what any criterion allows."""
    return np.max([one.cells / one.goal(follows) ** (1 / one.power) for one in every], axis=0)
