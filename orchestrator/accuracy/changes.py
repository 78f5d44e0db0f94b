"""What the numbers of a summary are off by, from what they have changed by from mesh to mesh.

A number q(u_h) misses q(u) by c η^s, η the error in the energy norm, s between one and two: displacements and forces that act on what is
linear gain from the best of all fits, s = 2, others may not. On two meshes

    q(u) − q₂ = (q₂ − q₁) r^s/(1 − r^s),      r = η₂/η₁,

which is largest at s = 1: that is told. Where s is two it is (1 + r)/r times the truth, three where errors are halved, the factor of safety
that Roache takes with two grids (P. J. Roache, Perspective: a method for uniform reporting of grid refinement studies, J. Fluids Eng. 116,
1994, 405–413). Of the changes since the last two meshes the one that tells more counts, as one alone may be small by chance; where
errors are nearly alike, r > ``CLEAR``, a change tells of chance alone. Stresses at points may have no limit, and statuses are counts: of
these nothing is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from orchestrator.accuracy.passes import Pass
from orchestrator.results.extremes import STRESS
from orchestrator.results.summary.summary import jsonable, numbers_of

UNTOLD = ("iterations", "error_bound", "discretisation_error", "seconds", "peak_stress")
BACK = 2  # meshes before the last that it is beside
CLEAR = 0.8


def answers(summary: Mapping[str, object]) -> dict[str, float]:
    """The numbers of a summary that have a limit, by the names of ``numbers_of``."""
    return {name: value for name, value in numbers_of(jsonable(summary)).items()
            if name not in UNTOLD and not name.startswith("pairs.") and name.rpartition(".")[2] not in STRESS}


def errors(done: Sequence[Pass]) -> dict[str, float]:
    """Name → what it is off by, from mesh and iterations, estimated; what nothing tells of is left out, and quantities, of which more is known.

    done : meshes so far, the last one's numbers are meant
    """
    last = done[-1]
    found: dict[str, float] = {}
    for before in done[-1 - BACK:-1]:
        if last.error <= CLEAR * before.error:
            times = last.error / (before.error - last.error)
            for name in last.numbers.keys() & before.numbers.keys():
                found[name] = max(found.get(name, 0.0), times * abs(last.numbers[name] - before.numbers[name]))
    return {name: found[name] for name in last.numbers if name in found and name.rpartition(".")[0] not in last.quantities}
