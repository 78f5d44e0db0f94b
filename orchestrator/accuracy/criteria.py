"""The accuracy that is asked of a run, in the energy norm, beside what a mesh and its iterations
leave.

What the numbers of a summary are off by, from what they have changed by from mesh to mesh.

A number q(u_h) misses q(u) by c η^s, η the error in the energy norm, s between one and two:
displacements and forces that act on what is linear gain from the best of all fits, s = 2, others
may not. On two meshes

    q(u) − q₂ = (q₂ − q₁) r^s/(1 − r^s),      r = η₂/η₁,

which is largest at s = 1: that is told. Where s is two it is (1 + r)/r times the truth, three where
errors are halved, the factor of safety that Roache takes with two grids (P. J. Roache, Perspective:
a method for uniform reporting of grid refinement studies, J. Fluids Eng. 116, 1994, 405–413). Of
the changes since the last two meshes the one that tells more counts, as one alone may be small by
chance; where errors are nearly alike, r > ``CLEAR``, a change tells of chance alone. Stresses at
points may have no limit, and statuses are counts: of these nothing is told.

Whether the largest stress has a limit, from what meshes have found of it that are finer and finer
where it is.

At a re-entrant edge, where a support, a contact or another matter ends, stresses are of r^−a, 0 < a
≤ ½, so that a mesh of size h there finds some h^−a: no mesh is fine enough. Where stresses have a
limit a mesh misses it by some h. Two meshes tell of either what a third will find,

    σ₃ = σ₂ (h₂/h₃)^a,  a = ln(σ₂/σ₁) / ln(h₁/h₂),        σ₃ = σ₂ + (σ₂ − σ₁)(h₂ − h₃)/(h₁ − h₂),

and the nearer of both is believed.

M. L. Williams, Stress singularities resulting from various boundary conditions in angular corners
of plates in extension, J. Appl. Mech. 19, 1952, 526–528.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.accuracy.measured import FORESEEN, TRUSTED
from orchestrator.accuracy.passes import Pass, Peak
from orchestrator.method.stopping.error_estimate import ErrorEstimate
from orchestrator.results.extremes import STRESS
from orchestrator.results.solution import Solution
from orchestrator.results.summary.summary import numbers_of, View
from orchestrator.scene.mesh.size_map import edge_lengths

ITERATIONS = 0.1  # share of the iterations in what is asked for
AIM = 0.9  # what a mesh is made for: sizes are followed within some tenths, and counts even out


@dataclass(frozen=True)
class Criterion:
    """Errors that are asked, and that a mesh leaves, all relative.

    asked : of mesh and iterations together
    estimated : the mesh's error as its estimate tells it by itself; share : measured, None where it
        is not
    foreseen : the share that the next mesh will be judged by
    iterations : their error, nan where it is not known; legs : both are legs of a right-angled
        triangle, else they add up
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
        """Return what may be estimated on the next mesh; ``follows``: whether the iterations'
        tolerance
        does.
        """
        left = self.error - self.mesh
        allowed = min(left, ITERATIONS * self.asked) if follows else left
        return (AIM * self.asked - allowed) * self.foreseen

    def _with_iterations(self, mesh: float) -> float:
        if not math.isfinite(self.iterations):
            return mesh
        return math.hypot(mesh, self.iterations) if self.legs else mesh + self.iterations


def criterion(solution: Solution, found: ErrorEstimate, share: float | None, measurable: bool,
              asked: float) -> Criterion:
    """Return the criterion of a solution.

    found : the estimate; share : that it tells, see ``measured.told``
    measurable : whether the next mesh's will be
    """
    foreseen = share or (FORESEEN if measurable else TRUSTED)
    return Criterion(asked, found.relative, share, foreseen, solution.error_bound,
                     solution.scene.bonded,
                     found.cells)


UNTOLD = ("iterations", "error_bound", "discretisation_error", "seconds", "peak_stress")
BACK = 2  # meshes before the last that it is beside
CLEAR = 0.8  # of the error, or the size, before: meshes that are hardly finer tell nothing


def answers(summary: Mapping[str, object]) -> dict[str, float]:
    """The numbers of a summary that have a limit, by the names of ``numbers_of``."""
    return {name: value for name, value in numbers_of(View(summary)).items()
            if name not in UNTOLD and not name.startswith("pairs.")
            and name.rpartition(".")[2] not in STRESS}


def errors(done: Sequence[Pass]) -> dict[str, float]:
    """Name → what it is off by, from mesh and iterations, estimated; what nothing tells of is left
    out.

    done : meshes so far, the last one's numbers are meant
    """
    last = done[-1]
    found: dict[str, float] = {}
    for before in done[-1 - BACK:-1]:
        if last.error <= CLEAR * before.error:
            times = last.error / (before.error - last.error)
            for name in last.numbers.keys() & before.numbers.keys():
                found[name] = max(found.get(name, 0.0),
                                  times * abs(last.numbers[name] - before.numbers[name]))
    return {name: found[name] for name in last.numbers if name in found}


def peak_of(solution: Solution) -> Peak | None:
    """Of one mesh; None where no stress is known, or none is there."""
    found, mesh = solution.summary["peak_stress"], solution.scene.mesh
    if not found or not found["value"] > 0:
        return None
    node = np.square(mesh.nodes - found["at"]).sum(axis=1).argmin()
    return found["value"], float(edge_lengths(mesh.nodes,
                                              mesh.cells[(mesh.cells == node).any(axis=1),
                                                         :4]).mean())


def growth(peaks: Sequence[Peak | None]) -> float | None:
    """a of stresses that grow as h^−a, from the last mesh and two before it that are coarser there;
    None where they do not grow so, or
    there are no such meshes.

    peaks : mesh by mesh
    """
    clear: list[Peak] = []
    for peak in reversed([one for one in peaks if one]):
        if not clear or clear[-1][1] <= CLEAR * peak[1]:
            clear.append(peak)
    if len(clear) < 3:
        return None
    (third, h3), (second, h2), (first, h1) = clear[:3]
    if not third > second > first:
        return None
    endless = second * (h2 / h3) ** (math.log(second / first) / math.log(h1 / h2))
    limited = second + (second - first) * (h2 - h3) / (h1 - h2)
    return math.log(third / second) / math.log(h2 / h3) if third > (endless + limited) / 2 else None
