"""What pairs that stay as they were before loading cost where sides slide, beside what the mesh costs.

A die is pressed on a slab and dragged by more and more elements, with pairs that stay and with pairs that follow, to a law residual of
1e-6. Told is the energy of what the displacements differ by in the last load step, relative, and the mesh's estimated error.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, PositiveFloat

from benchmarks.kit.drawing import BLUE, GREY, panels
from benchmarks.kit.elasticity import energy
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.contact_cases import ironing
from orchestrator import Solution, config_from, solve
from orchestrator.results.summary.cautions import FIFTH

SIZE, PRESSED, STUCK = 0.1, 0.02, 0.01  # of the slab's elements; depth; push before the die slips


class Settings(Keys):
    """How far the die is dragged."""

    ways: Annotated[list[PositiveFloat], Field(min_length=1)] = Field([0.1, 0.2, 0.5, 1.0, 2.0], description="in elements of the slab")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All ways; one is worth to be followed from where it costs what the mesh costs."""
    study.columns = ("way", "apart", "mesh_error", "iterations_fixed", "iterations_follow", "sweeps_fixed", "sweeps_follow", "stop_reason")
    for way in settings.ways:
        fixed, follow = (_dragged(way, pairing) for pairing in ("fixed", "follow"))
        apart = energy(follow.scene, [u - v for u, v in zip(fixed.parts, follow.parts)])[-1] / energy(follow.scene, follow.parts)[-1]
        row = {"way": way, "apart": round(float(np.sqrt(apart)), 4), "mesh_error": round(follow.summary["discretisation_error"], 4),
               **{f"iterations_{name}": each.iterations for name, each in (("fixed", fixed), ("follow", follow))},
               **{f"sweeps_{name}": round(each.summary["sweeps"]["iterations"], 1) for name, each in (("fixed", fixed), ("follow", follow))},
               "stop_reason": follow.stop_reason}
        study.note(row, f"{way:g} elements: apart by {row['apart']:.1%}, mesh's error {row['mesh_error']:.1%}, "
                        f"{fixed.iterations} and {follow.iterations} iterations")
    figure, ((axes,),) = panels(size=(5.0, 3.2))
    ways = [row["way"] for row in study.rows]
    axes.loglog(ways, [row["apart"] for row in study.rows], "o-", color=BLUE, label="pairs that stay")
    axes.loglog(ways, [row["mesh_error"] for row in study.rows], color=GREY, label="the mesh")
    axes.axvline(FIFTH, color=GREY, linewidth=1, linestyle=":")
    axes.set(xlabel="slid, in elements", ylabel="energy error")
    axes.legend()
    study.figure(figure)


def _dragged(way: float, pairing: str) -> Solution:
    """The die pressed, then dragged so far beyond where it begins to slip."""
    data = ironing(SIZE, pairing)
    data["boundary"][-1]["displacement"] = [[0, None, -PRESSED], [STUCK + way * SIZE / 2, None, -PRESSED], [STUCK + way * SIZE, None, -PRESSED]]
    return solve(config_from({**data, "method": {"tolerance": {"law": 1e-6}, "max_iterations": 2000}}))
