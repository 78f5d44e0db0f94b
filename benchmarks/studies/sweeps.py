"""Sweeps whose variants begin with their neighbours' states, beside as many runs from zero: CPU seconds, iterations, errors, statuses.

Every variant is solved three times: in a sweep, by a run of its own from zero, and, every few of them, by one from zero to a tolerance a
hundred times as tight, whose displacements the true errors are measured from, max_t ‖v − u‖ / max_t ‖u‖ in energy. CPU seconds are of all
processes that a command has started; none of them draws its variants. The last scene has no friction, and one solution.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, PositiveInt

from benchmarks.kit.commands import cpu_of_children, orchestrate, whole_command
from benchmarks.kit.drawing import BLUE, GREY, panels
from benchmarks.kit.elasticity import energy
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.lap_joint import joint_scene
from orchestrator import BlackBoxError, Solution, build_scene, load_config

CONFIGS = Path(__file__).parents[2] / "configs"
SHARE = 0.3  # of the runs' CPU seconds, at most
TIGHT = 1e-2  # of the tolerance, to which the truth is solved
PLAIN = "output.figures=false"

Vary = Mapping[str, Sequence[Any]]


class Settings(Keys):
    """How much of it is done."""

    scenes: list[str] = Field(["bolts", "lap_joint", "flange", "hertz"], description="which scenes")
    every: PositiveInt = Field(3, description="of how many variants one has its true error measured")


def run(study: Study, settings: Settings = Settings()) -> None:
    """All scenes, one row for each variant."""
    study.columns = ("scene", "variant", "cpu", "alone_cpu", "iterations", "alone_iterations", "error_bound", "true_error",
                     "alone_true_error", "other_statuses")
    for name in settings.scenes:
        path, vary = scene_of(study, name)
        _solved(study, name, path, vary, settings.every)
    for name in settings.scenes:
        _judge(study, name)
    study.figure(_picture(study, settings.scenes))


def scene_of(study: Study, name: str) -> tuple[Path, Vary]:
    """The configuration of a scene, and what varies."""
    if name == "bolts":
        return CONFIGS / "bolts.yaml", {"interfaces.0.friction": [round(0.10 + 0.01 * k, 2) for k in range(10)]}
    if name == "flange":
        return CONFIGS / "flange.yaml", {"boundary.0.traction": [[0, 0, force] for force in (22, 26, 30, 34, 38)],
                                         "interfaces.0.friction": [0.12, 0.14, 0.16, 0.18]}
    if name == "hertz":
        return CONFIGS / "hertz.yaml", {"boundary.4.displacement": [[None, None, -1e-4 * depth] for depth in (16, 18, 20, 22, 24)]}
    path = study.folder / "lap_joint.yaml"
    path.write_text(json.dumps(joint_scene(study.folder, (0.25, 0.5, 0.75, 1.0))), encoding="utf-8")
    return path, {"bolts.*.force": [20e3 + 1e3 * k for k in range(10)]}


def _solved(study: Study, name: str, path: Path, vary: Vary, every: int) -> None:
    """A row for each variant of a scene."""
    sets = [dict(zip(vary, values)) for values in product(*vary.values())]
    names = [f"{key}={','.join(map(json.dumps, values))}" for key, values in vary.items()]
    asked = {"path": path.read_text(encoding="utf-8"), "vary": names, "every": every}
    if not study.resume:  # compiled loops and bytecode are there then
        whole_command(study, f"{name}_alone", path, overrides=[PLAIN, "method.max_iterations=1"])
    swept = study.kept(f"{name}-sweep", asked, lambda: _swept(study, name, path, names))
    for number, values in enumerate(sets):
        row = study.kept(f"{name}-{number}", asked, lambda: _beside(study, name, path, swept["folders"][number], values,
                                                                    number % every == every - 1))
        row = {"scene": name, "variant": Path(swept["folders"][number]).name, "cpu": swept["cpu"] / len(sets), **row}
        study.note(row, f"{name}, {row['variant']}: {row['iterations']} iterations, {row['alone_iterations']} from zero")


def _swept(study: Study, name: str, path: Path, names: Sequence[str]) -> dict[str, Any]:
    """CPU seconds of a sweep, and its folders."""
    before, folder = cpu_of_children(), study.folder / f"{name}_sweep"
    varied = [word for text in names for word in ("--vary", text)]
    with orchestrate(path, *varied, "--output", str(folder), "--set", PLAIN, "--quiet", command="sweep") as process:
        complaint = process.communicate()[1]
    if process.returncode:
        raise BlackBoxError(f"{name}: the sweep has ended with code {process.returncode}: {complaint}")
    notes = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))["variants"]
    return {"cpu": cpu_of_children() - before, "folders": [str(folder / one["name"]) for one in notes]}


def _beside(study: Study, name: str, path: Path, folder: str, values: Mapping[str, Any], true: bool) -> dict[str, Any]:
    """A variant beside a run from zero and, if asked for, a tighter one."""
    changes, before = [PLAIN, *(f"{key}={json.dumps(value)}" for key, value in values.items())], cpu_of_children()
    alone, _ = whole_command(study, f"{name}_alone", path, overrides=changes)
    cpu = cpu_of_children() - before
    here, zero = Solution.read(folder), Solution.read(study.folder / f"{name}_alone")
    tolerance = alone["tolerance"]
    row = {"alone_cpu": cpu, "iterations": here.iterations, "alone_iterations": zero.iterations, "asked": tolerance,
           "error_bound": here.error_bound, "other_statuses": int(np.max(np.sum(
               here.interfaces.status != zero.interfaces.status, axis=-1))), "points": here.interfaces.status.shape[-1]}
    if true:
        tight = [*changes, f"method.tolerance.error={TIGHT * tolerance}"]
        whole_command(study, f"{name}_tight", path, overrides=tight)
        scene, truth = build_scene(load_config(path, changes).config), Solution.read(study.folder / f"{name}_tight")
        size = energy(scene, truth.sides).max()
        row |= {f"{which}true_error": float(np.sqrt(energy(scene, [a - b for a, b in zip(found.sides, truth.sides)]).max() / size))
                for which, found in (("", here), ("alone_", zero))}
    return row


def _judge(study: Study, name: str) -> None:
    rows = [row for row in study.rows if row["scene"] == name]
    cpu, alone = (sum(row[key] for row in rows) for key in ("cpu", "alone_cpu"))
    study.target(f"{name}: CPU seconds of {len(rows)} variants, over those of as many runs", f"at most {SHARE:g}",
                 f"{cpu:.1f} / {alone:.1f} = {cpu / alone:.2f}", cpu <= SHARE * alone)
    for key, what in (("error_bound", "told"), ("true_error", "true")):
        worst = max(row[key] / row["asked"] for row in rows if key in row)
        study.target(f"{name}: error {what}, over what was asked", "at most 1", f"{worst:.2f}", worst <= 1)
    if name == "hertz":
        others = max(row["other_statuses"] for row in rows)
        study.target(f"{name}: points with another status than from zero", "0", others, others == 0)


def _picture(study: Study, names: Sequence[str]):
    figure, (axes,) = panels(1, len(names), size=(3.2 * len(names), 3.0))
    for each, name in zip(axes, names):
        rows = [row for row in study.rows if row["scene"] == name]
        for key, colour, label in (("alone_iterations", GREY, "from zero"), ("iterations", BLUE, "in the sweep")):
            each.plot([row[key] for row in rows], "o-", color=colour, markersize=3, linewidth=0.8, label=label)
        each.set(title=name.replace("_", " "), xlabel="variant", ylabel="iterations", ylim=(0, None))
        each.legend()
    return figure
