"""Contact beside Newton's method in one piece: CPU seconds and memory to the same energy error, on the same discrete problems.

The rival is ``benchmarks.monolithic``: all load steps one after the other by a semismooth Newton method with a sparse
LU of displacements and pair forces, told nothing by the product. Each has a process of its own and gets the same scene,
whose making counts for neither; the product's seconds have its codes' in them, its certificate and what is delivered.
CPU seconds tell what a busy machine hides.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Mapping, Sequence
from multiprocessing import get_context, TimeoutError
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PositiveFloat

from benchmarks.kit.commands import cpu_seconds
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.kit.truth import Truth
from benchmarks.problems.cases import STEEL
from benchmarks.studies.grains import problem
from orchestrator import OrchestratorError, build_scene, load_config, solve

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
ERROR = 1e-4  # energy error that the product is asked for; the rival's own is far below
ELEMENTS = 3.0  # across a grain
WANTED = {"ten grains": 1.5, "27 free": 1.2, "27 rollers": 1.5, "64 free": 4.0, "125 free": 5.0}  # rival's CPU over ours
CODES = {"punch": ["blackbox.*.code=freefem"]}  # overrides: one code for all parts


class Settings(Keys):
    """Which scenes are run."""

    scenes: list[str] = Field(["punch", "ten grains", "27 free", "27 rollers", "64 free", "64 rollers", "flange"],
                              description="punch, ten grains, flange, or a number of grains and free or rollers")
    friction: PositiveFloat = Field(0.3, description="coefficient of friction between the grains that are numbered")
    seed: int = Field(1, description="of the grains' centres")
    patience: PositiveFloat = Field(600.0, description="wall seconds that the rival gets for a scene")


def scene_of(name: str, friction: float, seed: int) -> Mapping[str, Any] | Path:
    """Return a scene's configuration by its name, or the place of a file."""
    files = {"punch": "punch", "ten grains": "polycrystal_10", "flange": "flange"}
    if name in files:
        return CONFIGS / f"{files[name]}.yaml"
    count, sides = name.split()
    config = problem(int(count), seed, ELEMENTS, friction=friction, sides=sides)
    return {**config, "materials": STEEL, "output": {"figures": False}}


def run(study: Study, settings: Settings = Settings()) -> None:
    """Each scene by both."""
    study.columns = ("scene", "bodies", "dofs", "iterations", "cpu", "GB", "told", "true_error", "newton_steps", "rival_cpu",
                     "rival_GB", "rival_residual", "ratio")
    for name in settings.scenes:
        row = {"scene": name, **study.kept(name.replace(" ", "-"), settings.model_dump() | {"scene": name},
                                           lambda: _raced(study, name, settings))}
        study.note(row, f"{name}: " + (row["failure"] if "failure" in row else
                   f"{row['iterations']} iterations, {row['cpu']:.1f} CPU s; rival {row['newton_steps']} steps, "
                   f"{row['rival_cpu']:.1f} CPU s, {row['ratio']:.2f} times ours"))
    for row in study.rows:
        if "ratio" in row and row["scene"] in WANTED:
            least = WANTED[row["scene"]]
            study.target(f"{row['scene']}: rival's CPU over ours", f"at least {least}", f"{row['ratio']:.2f}", row["ratio"] >= least)
            study.target(f"{row['scene']}: true error over what was asked", "at most 1", f"{row['true_error'] / ERROR:.2f}",
                         row["true_error"] <= ERROR)


def _raced(study: Study, name: str, settings: Settings) -> dict[str, Any]:
    """Columns of one scene."""
    config = scene_of(name, settings.friction, settings.seed)
    if not isinstance(config, Path):
        path = study.folder / f"{name.replace(' ', '-')}.yaml"
        path.write_text(json.dumps(config, indent=1), encoding="utf-8")  # JSON is YAML
        config = path
    spawn, codes = get_context("spawn"), CODES.get(name, [])
    with spawn.Pool(1) as pool:
        ours, sides = pool.apply(in_parts, (config, codes))
    if sides is None:
        return ours
    with spawn.Pool(1) as pool:  # which ends its process
        try:
            rival = pool.apply_async(in_one_piece, (config, codes, sides)).get(settings.patience)
        except TimeoutError:
            return {**ours, "failure": f"{ours['iterations']} iterations, {ours['cpu']:.1f} CPU s; the rival is not there "
                    f"after {settings.patience:g} s"}
    return {**ours, **rival, "ratio": rival["rival_cpu"] / ours["cpu"]}


def in_parts(path: Path, codes: Sequence[str]) -> tuple[dict[str, Any], list[np.ndarray] | None]:
    """Return the product's columns, and displacements per subdomain; None where it fails."""
    config = load_config(path, overrides=[
        *codes, f"method.tolerance.error={ERROR}", "method.max_iterations=200", "output.figures=false"]).config
    scene, begin = build_scene(config), cpu_seconds()
    try:
        solution = solve(config, scene)
    except OrchestratorError as error:
        return {"failure": " ".join(str(error).split())}, None
    summary = solution.summary
    return {"bodies": summary["subdomains"], "dofs": summary["dofs"], "iterations": summary["iterations"],
            "stop_reason": summary["stop_reason"], "cpu": cpu_seconds() - begin,
            "GB": summary["memory_peak_mb"] / 1000, "told": summary["error_bound"]}, solution.parts


def in_one_piece(path: Path, codes: Sequence[str], sides: list[np.ndarray]) -> dict[str, Any]:
    """Return the rival's columns, and the true error of displacements (T, n_E, 3) beside the nearest solution in one piece."""
    scene, begin = build_scene(load_config(path, overrides=codes).config), time.process_time()
    truth = Truth(scene)
    spent = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    near = [truth] if truth.known and truth.error(sides) <= ERROR else [truth, Truth(scene, sides)]
    errors = [each.error(sides) for each in near if each.known]
    return {"newton_steps": truth.newton, "rival_cpu": spent, "rival_residual": truth.residual, "rival_GB": memory,
            "true_error": min(errors, default=float("nan"))}
