"""Load paths on which contacts open, close, stick and slip again, with much friction: iterations to an energy error.

Grains are pressed, let go and pressed again; pressed and twisted there and back; pressed and sheared with a friction of .6 and 1. Walls of
bricks with a friction of 1 are pressed and pushed along.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import Annotated, Any

from pydantic import Field, PositiveFloat, PositiveInt

from benchmarks.kit.drawing import PALETTE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.cases import grains, with_method
from benchmarks.problems.walls import wall
from benchmarks.studies.grains import TOP
from orchestrator import BlackBoxError, config_from, solve

WANTED = {1e-4: 60, 1e-6: 120}  # iterations at most, by tolerance
ELEMENTS = 5.0  # across a grain
PRESSED, PUSHED = [0, 0, -1e-3], [2e-3, 0, -1e-3]
SCREWED = {"translate": PRESSED, "rotate": {"axis": "z", "degrees": 0.1, "about": [0.5, 0.5, 1]}}
HISTORY = [0.5, 1, 0.5, 1]  # of the screw


class Settings(Keys):
    """What to run: all paths, with every seed where they are of grains, to every tolerance."""

    grains: PositiveInt = Field(27, description="their number")
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = Field([2, 3, 4], description="of the grains' centres")
    walls: list[tuple[PositiveInt, PositiveInt]] = Field([(4, 3), (6, 3), (12, 11)], description="rows, and bricks in a row")
    tolerances: Annotated[list[PositiveFloat], Field(min_length=1)] = Field([*WANTED], description="of the energy error")
    iterations: PositiveInt = Field(250, description="after which a run has failed")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All runs, path by path."""
    study.columns = ("path", "seed", "tolerance", "stop_reason", "iterations", "error_bound", "newton_steps", "seconds")
    for (path, seed, config), tolerance in product(problems(settings), settings.tolerances):
        asked = with_method(config, {"tolerance": {"error": tolerance}, "max_iterations": settings.iterations})
        name = f"{path}-{seed}-{tolerance:g}".replace(" ", "-").replace(",", "")
        row = {"path": path, "seed": seed, "tolerance": tolerance, **study.kept(name, asked, lambda: _measured(asked))}
        study.note(row, f"{path}, {seed}, {tolerance:g}: " + (
            f"failed, {row['failure']}" if "failure" in row else f"{row['iterations']} iterations, {row['stop_reason']}"))
    for path, tolerance in product(dict.fromkeys(row["path"] for row in study.rows), settings.tolerances):
        rows = [row for row in study.rows if (row["path"], row["tolerance"]) == (path, tolerance)]
        most = WANTED.get(tolerance, settings.iterations)
        study.target(f"{path}, energy error {tolerance:g}", f"at most {most} iterations",
                     ", ".join(str(row.get("iterations", "failed")) for row in rows),
                     all(row.get("stop_reason") == "converged" and row["iterations"] <= most for row in rows))
    study.figure(_picture(study, settings))


def problems(settings: Settings) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Path, seed and configuration of all scenes."""
    count, height = settings.grains, float(f"{settings.grains ** (-1 / 3) / ELEMENTS:.4g}")
    paths: dict[str, Callable[[int], dict[str, Any]]] = {
        "pressed, let go, pressed": lambda seed: grains(count, height, 0.3, [PRESSED, [0, 0, 0], PRESSED], seed=seed),
        "twisted": lambda seed: twisted(grains(count, height, 0.3, seed=seed)),
        "sheared, friction .6": lambda seed: grains(count, height, 0.6, TOP, seed=seed),
        "sheared, friction 1": lambda seed: grains(count, height, 1.0, TOP, seed=seed),
    }
    for path, seed in product(paths, settings.seeds):
        yield path, seed, paths[path](seed)
    for rows, bricks in settings.walls:
        yield f"wall {rows} by {bricks}", 0, wall(rows, bricks, 1.0, [PRESSED, PUSHED])


def twisted(config: dict[str, Any]) -> dict[str, Any]:
    """The same with the top pressed and turned there and back."""
    base, top = config["boundary"]
    screw = {"on": top["on"], "motion": SCREWED, "history": "screw"}
    return {**config, "histories": {"screw": HISTORY}, "boundary": [base, screw]}


def _measured(config: dict[str, Any]) -> dict[str, Any]:
    try:
        summary = solve(config_from(config)).summary
    except BlackBoxError as error:
        return {"failure": " ".join(str(error).split())}
    return {**{key: summary[key] for key in ("stop_reason", "iterations", "error_bound", "newton_steps")},
            "seconds": round(summary["timing"]["total"], 2)}


def _picture(study: Study, settings: Settings):
    """Iterations of every run, path by path."""
    figure, ((axes,),) = panels(size=(8.0, 4.2))
    paths = list(dict.fromkeys(row["path"] for row in study.rows))
    for tolerance, colour in zip(settings.tolerances, PALETTE):
        rows = [row for row in study.rows if row["tolerance"] == tolerance and "iterations" in row]
        axes.plot([paths.index(row["path"]) for row in rows], [row["iterations"] for row in rows], "o", color=colour,
                  label=f"energy error {tolerance:.0e}")
        if tolerance in WANTED:
            axes.axhline(WANTED[tolerance], color=colour, linewidth=1, linestyle=":")
    axes.set_xticks(range(len(paths)), [path.replace(", ", ",\n", 1) for path in paths], fontsize=8)
    axes.set(ylim=(0, None), ylabel="iterations")
    axes.legend()
    return figure
