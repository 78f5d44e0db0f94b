"""Newton's method in one piece from the fields of a run: whether it pays to end with it where a tight tolerance is asked.

A run to an error is taken over by ``benchmarks.monolithic``, which gets displacements and pair forces of all load steps
and goes on to rounding. Beside it the same run goes on by itself, to the tight error. Both are in one process, so that
CPU seconds can be compared; those of the codes count. Newton's method needs the stiffness of all bodies, which a black box does not tell:
here it is assembled anew.
"""

from __future__ import annotations

import time
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from benchmarks.kit.commands import cpu_seconds
from benchmarks.kit.elasticity import energy
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.metamorphic.oracle import started
from benchmarks.monolithic import Monolithic
from benchmarks.problems.cases import STEEL, with_method
from benchmarks.studies.grains import problem, Sides
from orchestrator import build_scene, config_from, Scene, Solution, solve


class Settings(Keys):
    """Which scenes are run, and where Newton's method takes over."""

    counts: Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=1)] = Field([27], description="numbers of grains")
    sides: Annotated[list[Sides], Field(min_length=1)] = Field(["rollers", "free"], description="free, or rollers")
    seed: int = Field(1, description="of the grains' centres")
    friction: PositiveFloat = Field(0.3, description="coefficient of friction")
    elements: PositiveFloat = Field(3.0, description="elements across a grain")
    errors: Annotated[list[PositiveFloat], Field(min_length=1)] = Field([1e-3, 1e-4, 1e-6], description="energy errors at which it takes over")
    tight: PositiveFloat = Field(1e-7, description="energy error that is asked for in the end")
    most: int = Field(30, ge=1, description="Newton steps of an attempt")


def run(study: Study, settings: Settings = Settings()) -> None:
    """A row for every scene and error."""
    study.columns = ("grains", "sides", "error", "iterations", "cpu", "newton_steps", "newton_cpu", "residual", "apart", "more_iterations",
                     "more_cpu")
    for count, sides in product(settings.counts, settings.sides):
        config = problem(count, settings.seed, settings.elements, friction=settings.friction, sides=sides)
        scene = build_scene(config_from({**config, "materials": STEEL}))
        tight, spent = _solved(scene, config, settings.tight)
        for error in settings.errors:
            solution, cpu = _solved(scene, config, error)
            iterations = solution.summary["iterations"]
            row = {"grains": count, "sides": sides, "error": error, "iterations": iterations, "cpu": cpu,
                   **_ended(scene, solution, settings.most),
                   "more_iterations": tight.summary["iterations"] - iterations, "more_cpu": spent - cpu}
            study.note(row, f"{count} grains, {sides}, from {error:g}: Newton {row['newton_steps']} steps, {row['newton_cpu']:.1f} CPU s to "
                            f"{row['residual']:.0e}; ours {row['more_iterations']} iterations, {row['more_cpu']:.1f} CPU s to "
                            f"{settings.tight:g}, {tight.summary['stop_reason']}")
            if row["residual"] <= 1e-10:
                study.target(f"{count} grains, {sides}, from {error:g}: distance to Newton's solution over the error asked for", "at most 1",
                             f"{row['apart'] / error:.2f}", row["apart"] <= error)


def _solved(scene: Scene, config: dict[str, Any], error: float) -> tuple[Solution, float]:
    """A run to an error, and its CPU seconds."""
    asked = with_method({**config, "materials": STEEL}, {"max_iterations": 400, "tolerance": {"error": error}})
    begin = cpu_seconds()
    solution = solve(config_from({**asked, "output": {"figures": False}, "blackbox": {"workers": 1}}), scene)
    return solution, cpu_seconds() - begin


def _ended(scene: Scene, solution: Solution, most: int) -> dict[str, Any]:
    """Columns of Newton's method from there, and how far apart both are, relative, in energy."""
    begin = time.process_time()
    whole = Monolithic(scene)
    whole.most = most
    steps = whole.solve(started(whole, solution))
    spent = time.process_time() - begin
    parts = [np.stack(part) for part in zip(*(step.parts for step in steps))]
    apart = energy(scene, [u - v for u, v in zip(solution.parts, parts)]).max() / energy(scene, parts).max()
    return {"newton_steps": sum(step.newton for step in steps), "newton_cpu": spent,
            "residual": max(step.residual for step in steps), "apart": float(np.sqrt(apart))}
