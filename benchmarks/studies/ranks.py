"""Grains in contact over one, two and four ranks, and with two kernels of OpenBLAS: the same forces and verdict; what four ranks take.

Ranks sum in another order, and kernels multiply in another one: numbers differ in their last digits from the first iteration on. Statuses
of contact may turn them into more, as long as the tolerance allows it. Each run is the whole command in processes of its own.

Resultants of interfaces are compared load step by load step, and fields in energy, ‖u − v‖ / max_t ‖v‖ over all bodies: the distance of
the forces on each body as well, in the dual norm. With friction neither is unique where three bodies meet at a line: forces go round it in
circles that no body feels, and move the limits of friction there. What one load step leaves open is history to the next ones.

CPU seconds of four ranks are predicted from the runs with one and two, part by part: a further rank costs what the second one did,

    c(R) = c(1) + (R − 1) (c(2) − c(1)),

in the iterations for each of them, of which there are as many as with one rank.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from benchmarks.kit.commands import CORES, codes_seconds, cpu_of_children, environment, whole_command, without_ranks
from benchmarks.kit.drawing import BLUE, GREEN, GREY, ORANGE, panels
from benchmarks.kit.settings import Keys
from benchmarks.kit.study import Study
from benchmarks.problems.cases import with_method
from benchmarks.studies.falsified import apart
from benchmarks.studies.grains import Sides, problem
from orchestrator import build_scene, config_from, Scene, Solution

AGREE = 1e-6  # relative, by which forces and fields may differ
OFF, ALONE = 0.2, 0.5  # how far the prediction may be off; others' load up to which wall seconds tell something of it
FROM, TO = (1, 2), 4  # ranks that costs come from, and that are predicted
FORCES = ("fx", "fy", "fz")
PARTS = ("codes", "set_up", "iterating", "all_else")

Rows = Sequence[Mapping[str, Any]]


class Settings(Keys):
    """What to run: every number of grains with every kernel over every number of ranks."""

    counts: Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=1)] = Field([343], description="numbers of grains")
    sides: Annotated[list[Sides], Field(min_length=1)] = Field(["rollers"], description="free, or rollers")
    seed: NonNegativeInt = Field(1, description="of the grains' centres")
    elements: PositiveFloat = Field(3.0, description="elements across a grain")
    friction: NonNegativeFloat = Field(0.3, description="coefficient of friction")
    tolerance: PositiveFloat = Field(1e-7, description="of the energy error")
    ranks: Annotated[list[PositiveInt], Field(min_length=1)] = Field([1, 2, 4], description="MPI ranks")
    kernels: Annotated[list[str], Field(min_length=1)] = Field(["Haswell", "SkylakeX"], description=(
        "OPENBLAS_CORETYPE of the runs, each with every number of ranks; an empty text: this processor's own"))


def run(study: Study, settings: Settings = Settings()) -> None:
    """A row for each run; agreement and prediction for each scene."""
    study.columns = ("grains", "sides", "kernel", "ranks", "dofs_decomposed", "stop_reason", "iterations", "error_bound", "forces", "fields",
                     "reactions", "seconds", "cpu", "others", *PARTS)
    missing = without_ranks()
    if missing is not None:
        study.console.print(f"  runs over ranks are left out: {missing}")
    for count, sides in product(settings.counts, settings.sides):
        config = with_method(problem(count, settings.seed, settings.elements, friction=settings.friction, sides=sides),
                             {"max_iterations": 400, "tolerance": {"error": settings.tolerance}})
        config |= {"output": {"figures": False}, "blackbox": {"workers": 1}}
        scene = build_scene(config_from(config))
        rows: list[dict[str, Any]] = []
        for kernel, ranks in product(settings.kernels, settings.ranks if missing is None else [1]):
            name = f"grains-{count}-{sides}-{kernel or 'own'}-{ranks}"
            found = study.kept(name, {"config": config}, lambda: _measured(study, name, config, kernel, ranks))
            row = {"grains": count, "sides": sides, "kernel": kernel, "ranks": ranks, "folder": str(study.folder / name), **found}
            rows.append(row | differences(scene, row, rows[0] if rows else row))
            study.note(rows[-1], f"{count} grains, {sides}, {kernel}, {ranks} rank(s): {row['iterations']} iterations, {row['stop_reason']}, "
                                 f"forces differ by {rows[-1]['forces']:.1e}, {row['cpu']:.1f} CPU s")
        _judge(study, f"{count} grains, {sides}", rows)
    study.figure(_picture(study.rows))


def _measured(study: Study, name: str, config: dict[str, Any], kernel: str, ranks: int) -> dict[str, Any]:
    others, begin = os.getloadavg()[0], cpu_of_children()
    with environment({"OPENBLAS_CORETYPE": kernel} if kernel else {}):
        summary, seconds = whole_command(study, name, config, ranks)
    return {**{key: summary[key] for key in ("dofs_decomposed", "stop_reason", "iterations", "error_bound")}, "seconds": seconds,
            "others": round(others, 1), **parts_of(summary, cpu_of_children() - begin)}


def forces_of(folder: str) -> np.ndarray:
    """(load steps, interfaces, 3) resultant forces of a run, in the order of its table."""
    with (Path(folder) / "interfaces.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    steps = sorted({int(row["load_step"]) for row in rows})
    return np.array([[[float(row[key]) for key in FORCES] for row in rows if int(row["load_step"]) == step] for step in steps])


def differences(scene: Scene, one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """How far two runs are apart: interfaces' resultants, fields in energy and reactions, each over the largest of all load steps; and the
    resultants of each load step."""
    u, v = (Solution.read(row["folder"]) for row in (one, other))
    a, b = (forces_of(row["folder"]) for row in (one, other))
    steps = np.abs(a - b).max(axis=(1, 2)) / np.abs(b).max()
    return {"forces": float(steps.max()), "forces_by_step": steps.tolist(), "fields": apart(scene, u, v),
            "reactions": float(np.abs(u.reactions - v.reactions).max() / np.abs(v.reactions).max())}


def parts_of(summary: Mapping[str, Any], cpu: float) -> dict[str, float]:
    """CPU seconds of a command, and of its parts: the codes by their own clocks, the orchestrator's set-up and iterations on all ranks."""
    setup, loop = (sum(rank["cpu"] for rank in summary["workload"][period]["ranks"]) for period in ("set_up", "iterations"))
    codes = codes_seconds(summary)
    return {"cpu": cpu, "codes": codes, "set_up": setup, "iterating": loop, "all_else": cpu - codes - setup - loop}


def predicted(rows: Rows, ranks: int) -> dict[str, float]:
    """Part → CPU seconds of a run over so many ranks, from those with one and two."""
    one, two = (next(row for row in rows if row["ranks"] == count) for count in FROM)
    found = {}
    for part in PARTS:
        a, b = (row[part] / (row["iterations"] if part == "iterating" else 1) for row in (one, two))
        found[part] = (a + (ranks - 1) * (b - a)) * (one["iterations"] if part == "iterating" else 1)
    return found


def _judge(study: Study, what: str, rows: Rows) -> None:
    if len(rows) > 1:
        for step, values in enumerate(zip(*(row["forces_by_step"] for row in rows)), 1):
            study.target(f"{what}: forces of interfaces at load step {step}, {len(rows)} runs", f"within {AGREE:g}",
                         f"{max(values):.1e}", max(values) <= AGREE)
        for key, told in (("fields", "fields, in energy"), ("reactions", "reactions")):
            worst = max(row[key] for row in rows)
            study.target(f"{what}: {told}, {len(rows)} runs", f"within {AGREE:g}", f"{worst:.1e}", worst <= AGREE)
        ends = sorted({row["stop_reason"] for row in rows})
        study.target(f"{what}: how they end", "alike", ", ".join(ends), ends == ["converged"])
    for kernel in dict.fromkeys(row["kernel"] for row in rows):
        own = [row for row in rows if row["kernel"] == kernel]
        found = {row["ranks"]: row for row in own}
        if not {*FROM, TO} <= found.keys():
            continue
        four, parts = found[TO], predicted(own, TO)
        total = sum(parts.values())
        told = ", ".join(f"{part} {parts[part]:.1f}, measured {four[part]:.1f}" for part in PARTS)
        study.target(f"{what}, {kernel}: CPU seconds of {TO} ranks, predicted from runs with 1 and 2", f"within {100 * OFF:.0f} %",
                     f"{total:.1f}, measured {four['cpu']:.1f}; {told}", abs(total / four["cpu"] - 1) <= OFF)
        if four["others"] <= ALONE:
            wall = total / min(CORES, TO)
            study.target(f"{what}, {kernel}: wall seconds, if all cores share them", "told", f"{wall:.1f}, measured {four['seconds']:.1f}", True)


def _picture(rows: Rows):
    """CPU seconds by parts, and iterations, of every run."""
    figure, ((left, right),) = panels(1, 2, (11.0, 4.0))
    names = [f"{row['grains']} {row['sides']}\n{row['kernel']}, {row['ranks']}" for row in rows]
    below = np.zeros(len(rows))
    for part, colour in zip(PARTS, (BLUE, GREEN, ORANGE, GREY)):
        values = np.array([row[part] for row in rows])
        left.bar(names, values, 0.5, below, color=colour, label=part)
        below += values
    right.bar(names, [row["iterations"] for row in rows], 0.5, color=BLUE)
    for axes, title in ((left, "CPU seconds"), (right, "iterations")):
        axes.set_title(title, fontsize=10)
        axes.tick_params(axis="x", labelsize=6)
    left.legend(fontsize=7)
    return figure
